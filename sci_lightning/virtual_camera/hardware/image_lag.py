"""What a capture leaves behind for the next one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sci_lightning.virtual_camera.hardware.parameter import parameter
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect


@dataclass(frozen=True)
class ImageLag(SensorEffect):
    """Pixels are not quite empty after readout: a ``fraction`` of each capture is in the next. Outside the vocabulary.

    Captures follow each other as they are numbered; nothing precedes the first.
    """

    name = "image_lag"
    fraction: float = parameter("1", 0, 0.5, (0.01, 0.05), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout, chart: np.ndarray | None) -> np.ndarray:
        before = np.concatenate((np.zeros_like(signal[:1]), signal[:-1]))
        return signal + self.fraction * before
