"""How decoders are computed: by the formulas of their papers or in faster ways, and how features lie in memory.

Layers and networks are written as their papers have them. By default they hand the steps that take the time to faster
functions in the same file, which return the same values to rounding: convolution over time, attention, total variation
in place. ``use(decoder, "plain")`` turns these off, to check a result or to find out where a difference comes from; on
the command line it is ``kernels=plain``. A module with a faster way has an attribute ``plain_formulas``.

Convolutions on CPUs and GPUs run fastest, and without copies in between, on features whose channels lie next to each
other (``channels_last``). Shapes and values do not depend on it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import nn

from sci_lightning.errors import BadInput

KERNELS = ("auto", "plain")
"""``auto`` takes the fastest way for every shape and device, ``plain`` computes the formulas as they are written."""

REDUCED = (torch.bfloat16, torch.float16)


def use(network: nn.Module, kernels: str) -> None:
    """Choose how a decoder, or any other network of this package, is computed from now on.

    Args:
        network: it and all modules inside it change.
        kernels: ``auto`` or ``plain``.

    Raises:
        BadInput: another name.

    Example:
        >>> import torch
        >>> from sci_lightning.decoder import RevSCI
        >>> from sci_lightning.decoder.layers import kernels
        >>> decoder, measurement, mask = RevSCI(blocks=1, channels=8), torch.rand(1, 8, 8), torch.rand(4, 8, 8)
        >>> fast = decoder(measurement, mask)
        >>> kernels.use(decoder, "plain")
        >>> torch.allclose(decoder(measurement, mask), fast, atol=1e-5)
        True
    """
    if kernels not in KERNELS:
        raise BadInput(f"kernels={kernels}: choose {' or '.join(KERNELS)}")
    for module in _with_faster_ways(network):
        module.plain_formulas = kernels == "plain"


@contextmanager
def plainly(network: nn.Module) -> Iterator[None]:
    """Compute a network by its formulas inside a ``with`` block."""
    changed = [module for module in _with_faster_ways(network) if not module.plain_formulas]
    for module in changed:
        module.plain_formulas = True
    try:
        yield
    finally:
        for module in changed:
            module.plain_formulas = False


def _with_faster_ways(network: nn.Module) -> list[Any]:
    return [module for module in network.modules() if hasattr(module, "plain_formulas")]


def is_reduced(x: torch.Tensor) -> bool:
    """Return whether products of x are computed in bfloat16 or float16, for which other ways are fastest.

    They are because of the type of x, or by autocast.
    """
    device = x.device.type
    return x.dtype in REDUCED or (device != "meta" and torch.is_autocast_enabled(device))


def channels_last(x: torch.Tensor) -> torch.Tensor:
    """Return features ``(N, C, H, W)`` or ``(N, C, T, H, W)`` in channels-last layout."""
    return x.contiguous(memory_format=torch.channels_last if x.ndim == 4 else torch.channels_last_3d)


def as_one_channel(video: torch.Tensor) -> torch.Tensor:
    """Return a video ``(N, T, H, W)`` as features ``(N, 1, T, H, W)``.

    The strides say that the layout is channels-last; torch cannot tell with a single channel.
    """
    return video.contiguous().unsqueeze(-1).permute(0, 4, 1, 2, 3)


def as_frames(x: torch.Tensor) -> torch.Tensor:
    """Return features ``(N, C, T, H, W)`` as frames ``(N T, C, H, W)``, without a copy from channels-last layout."""
    return x.transpose(1, 2).flatten(0, 1)


def as_video(x: torch.Tensor, snapshots: int) -> torch.Tensor:
    """Return frames ``(N T, C, H, W)`` as features ``(N, C, T, H, W)``, where N is the number of snapshots."""
    return x.unflatten(0, (snapshots, -1)).transpose(1, 2)
