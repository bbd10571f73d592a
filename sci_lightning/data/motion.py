"""The path of a picture that pans, turns and zooms."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch


@dataclass(frozen=True)
class Motion:
    """A smooth path without end that never leaves the neighbourhood of its centre.

    At time t (frames) the layer's centre is at ``centre + reach * sin(rate * t + phase)`` pixels from the
    middle of the picture, per axis, its angle is ``angle + spin * t`` (radian), and it is
    ``exp(zoom * sin(rate * t))`` times as large as at rest. The peak speed is ``reach * rate``.
    """

    centre: np.ndarray
    reach: np.ndarray
    phase: np.ndarray
    rate: float
    angle: float
    spin: float
    zoom: float

    @classmethod
    def draw(
        cls,
        random: np.random.Generator,
        centre: np.ndarray,
        *,
        reach: float,
        speed: float,
        tilt: float,
        spin: float,
    ) -> Motion:
        """A random motion within ``reach`` (pixels), at up to ``speed`` (pixels per frame).

        It starts turned by up to ``tilt`` (radian) and turns by up to ``spin`` (radian per frame).
        """
        return cls(
            centre=centre,
            reach=reach * random.uniform(0.3, 1, 2),
            phase=random.uniform(0, 2 * math.pi, 2),
            rate=speed / reach,
            angle=random.uniform(-tilt, tilt),
            spin=random.uniform(-spin, spin),
            zoom=random.uniform(0, 0.15),
        )

    def to_layer(self, times: torch.Tensor) -> torch.Tensor:
        """(T, 2, 3): takes pixels of the picture to pixels of the layer, both counted from the middle."""
        centre, reach, phase = map(torch.from_numpy, (self.centre, self.reach, self.phase))
        place = centre + reach * torch.sin(self.rate * times[:, None] + phase)
        angle = self.angle + self.spin * times
        size = torch.exp(self.zoom * torch.sin(self.rate * times))
        cos, sin = torch.cos(angle) / size, torch.sin(angle) / size
        turn = torch.stack((cos, sin, -sin, cos), 1).reshape(-1, 2, 2)
        return torch.cat((turn, -turn @ place[:, :, None]), 2)
