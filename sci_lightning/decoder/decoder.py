"""What all decoders have in common: the call, and the check of what they are called with."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels.switch import are_plain
from sci_lightning.errors import BadInput
from sci_lightning.imaging.operator import SnapshotOperator


class Decoder(nn.Module):
    """A decoder: ``decoder(measurement, mask) -> video``.

    Shapes: measurement ``(N, H, W)`` = sum over t of M_t x_t, mask ``(T, H, W)`` in [0, 1], video ``(N, T, H, W)``.
    Subclasses write :meth:`decode`, or :meth:`decode_stages` when they estimate more than once on the way; calling
    checks the shapes first.
    """

    frames: int | None = None
    """T, where the architecture is built for one; None: any."""
    multiple: ClassVar[int] = 1
    """The architecture takes H and W that are multiples of this; others are replicated up to one and cropped back."""
    published_names: ClassVar[tuple[tuple[str, str], ...]] = ()
    """What the authors call our state-dict keys: (regular expression of our key, replacement to make it theirs).

    An expression has to match all of a key. Where several match, the authors' tensors are joined in this order.
    """
    published_unused: ClassVar[tuple[str, ...]] = ()
    """Regular expressions of published state-dict keys that are not used on purpose."""

    def forward(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Estimate the video ``(N, T, H, W)``, nominally in [0, 1], not clipped: the last of :meth:`stages`.

        Raises:
            BadInput: shapes that do not fit together or that the architecture cannot take.
        """
        return self.stages(measurement, mask)[-1]

    def stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        """Every estimate of the video on the way, first to last, each ``(N, T, H, W)``; for losses that use them.

        Raises:
            BadInput: as the call.
        """
        if measurement.ndim != 3 or mask.ndim != 3 or measurement.shape[1:] != mask.shape[1:]:
            raise BadInput(
                f"decoder called with measurement {tuple(measurement.shape)} and mask {tuple(mask.shape)}; "
                "it takes measurement (N, H, W) and mask (T, H, W) of the same H and W"
            )
        if self.frames is not None and len(mask) != self.frames:
            raise BadInput(f"this {type(self).__name__} was built for {self.frames} frames, the mask has {len(mask)}")
        height, width = mask.shape[1:]
        margin = (0, -width % self.multiple, 0, -height % self.multiple)
        if any(margin):  # measurement and mask alike, so that they keep fitting each other
            measurement, mask = (F.pad(each, margin, mode="replicate") for each in (measurement, mask))
        estimates = self.decode_stages(measurement, mask)
        return [estimate[..., :height, :width].contiguous() for estimate in estimates]

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        """The estimates of :meth:`stages`, of checked input."""
        return [self.decode(measurement, mask)]

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """The one estimate, of checked input."""
        raise NotImplementedError

    @staticmethod
    def operator(mask: torch.Tensor) -> SnapshotOperator:
        """Return the snapshot operator of a mask ``(T, H, W)``, in the form that is fastest inside a network."""
        return SnapshotOperator(mask, slot_by_slot=not are_plain())
