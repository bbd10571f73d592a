"""What all decoders have in common: the call, and the check of what they are called with."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import nn

from sci_lightning.errors import BadInput


class Decoder(nn.Module):
    """A decoder: ``decoder(measurement, mask) -> video``.

    Shapes: measurement ``(N, H, W)`` = sum over t of M_t x_t, mask ``(T, H, W)`` in [0, 1], video ``(N, T, H, W)``.
    Subclasses write :meth:`decode`; calling checks the shapes first.
    """

    published_names: ClassVar[tuple[tuple[str, str], ...]] = ()
    """(regular expression of a published state-dict key, replacement that makes it ours), matched in full."""
    published_unused: ClassVar[tuple[str, ...]] = ()
    """Regular expressions of published state-dict keys that are knowingly not used."""

    def forward(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Estimate the video ``(N, T, H, W)``, nominally in [0, 1], not clipped.

        Raises:
            BadInput: shapes that do not fit together or that the architecture cannot take.
        """
        if measurement.ndim != 3 or mask.ndim != 3 or measurement.shape[1:] != mask.shape[1:]:
            raise BadInput(
                f"decoder called with measurement {tuple(measurement.shape)} and mask {tuple(mask.shape)}; "
                "it takes measurement (N, H, W) and mask (T, H, W) of the same H and W"
            )
        return self.decode(measurement, mask)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        raise NotImplementedError
