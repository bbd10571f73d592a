"""Luminance of a display from pixel values, and the light that each kind of photoreceptor absorbs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from sci_lightning.metrics.hdrvdp2.tabulated import precomputed

BLACK, RANGE = 1.0, 99.0
"""Luminance of the modelled display at pixel value 0, and the difference to that at 1, in cd/m2."""

D65 = ((0.601847152244699, 0.31670829557916946, 0.9046706545995032),)
CCFL_LCD = (
    (0.1989961203379287, 0.04100586040758893, 0.01437736862111919),
    (0.40476260703812544, 0.25492330644134564, 0.4809208410841319),
    (0.05439061925532116, 0.050012248959300676, 0.45427589566935994),
)
"""Light that L cones, M cones and rods absorb of every channel: cone sensitivities of Smith and Pokorny (1975) and the
CIE's scotopic one (1951) times the emission, integrated from 360 to 780 nm. S cones are not part of the model."""


def _luma(x: torch.Tensor) -> torch.Tensor:
    return RANGE * x**2.2 + BLACK


def _srgb(x: torch.Tensor) -> torch.Tensor:
    return RANGE * torch.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4) + BLACK


def _as_given(x: torch.Tensor) -> torch.Tensor:
    return x


@dataclass(frozen=True)
class Display:
    """A display: ``luminance`` turns pixel values into cd/m2, ``matrix`` turns channels into L, M and rod light."""

    luminance: Callable[[torch.Tensor], torch.Tensor]
    matrix: tuple[tuple[float, float, float], ...]

    def receptors(self, light: torch.Tensor) -> torch.Tensor:
        """Return the light on L cones, M cones and rods, (N, 3, H, W), from that on the retina, (N, C, H, W).

        A single channel stands for equal values of all channels of the display.
        """
        matrix = _matrix(light, self.matrix)
        if light.shape[1] == 1:
            return light * matrix.sum(0)[:, None, None]
        return torch.einsum("nchw,cr->nrhw", light, matrix)


DISPLAYS = {
    "luma-display": Display(_luma, D65),
    "sRGB-display": Display(_srgb, CCFL_LCD),
    "luminance": Display(_as_given, D65),
}
"""Displays by the encoding of their pixel values."""


@precomputed
def _matrix(rows: tuple[tuple[float, float, float], ...]) -> torch.Tensor:
    return torch.tensor(rows, dtype=torch.float64)
