"""The layout of images and features in memory.

Convolutions on CPUs and GPUs run fastest, and without copies in between, on features whose channels lie next to each
other (``channels_last``). Shapes and values do not depend on it.
"""

from __future__ import annotations

import torch

from sci_lightning.decoder.kernels.switch import are_plain


def channels_last(x: torch.Tensor) -> torch.Tensor:
    """Return features ``(N, C, H, W)`` or ``(N, C, T, H, W)`` in channels-last layout."""
    if are_plain():
        return x
    return x.contiguous(memory_format=torch.channels_last if x.ndim == 4 else torch.channels_last_3d)


def as_one_channel(video: torch.Tensor) -> torch.Tensor:
    """Return a video ``(N, T, H, W)`` as features ``(N, 1, T, H, W)``.

    The strides say that the layout is channels-last; torch cannot tell with a single channel.
    """
    if are_plain():
        return video.unsqueeze(1)
    return video.contiguous().unsqueeze(-1).permute(0, 4, 1, 2, 3)


def as_frames(x: torch.Tensor) -> torch.Tensor:
    """Return features ``(N, C, T, H, W)`` as frames ``(N T, C, H, W)``, without a copy from channels-last layout."""
    return x.transpose(1, 2).flatten(0, 1)


def as_video(x: torch.Tensor, snapshots: int) -> torch.Tensor:
    """Return frames ``(N T, C, H, W)`` as features ``(N, C, T, H, W)``, where N is the number of snapshots."""
    return x.unflatten(0, (snapshots, -1)).transpose(1, 2)
