"""What a hypothesis about the camera predicts."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.model.likelihood import ClippedSignal


@dataclass(frozen=True)
class Prediction:
    """What a hypothesis predicts for every pixel before the converter.

    Attributes:
        mean: ``(N, H, W)`` expected signal, DN.
        deviation: ``(N, H, W)`` its standard deviation, DN.
        bits: effective bits of the converter.
        clipped: the distribution where the signal saturates before the converter does; None if it does not.
        window: rows and columns of the field that it is of; None where nobody asks.
    """

    mean: torch.Tensor
    deviation: torch.Tensor
    bits: int
    clipped: ClippedSignal | None = None
    window: tuple[slice, slice] | None = None

    @property
    def total_variance(self) -> torch.Tensor:
        """``(N, H, W)`` variance of a pixel's DN, DN squared, quantisation counted as noise."""
        return self.deviation.square() + 1 / 12
