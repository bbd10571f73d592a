"""The baseline that any decoder must beat: the mean measurement in every frame."""

from __future__ import annotations

import torch

from sci_lightning.decoder.decoder import Decoder


class MeanMeasurement(Decoder):
    """Every frame of the estimate is the measurement over the sum of the masks."""

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.operator(mask).mean_video(measurement)
