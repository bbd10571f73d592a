"""Mask distortion: the relay lens bends straight rows of mirrors."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.encoder.effects.stage import PlacementEffect

MUCH = 0.06
"""Distortion of a lens that distorts much."""


class MaskDistortion(PlacementEffect):
    r"""Radial distortion: what should lie at distance r from the field's centre lies at :math:`r\,(1 + k r^2 / R^2)`.

    R is half the field's diagonal.

    Args:
        k: -0.3 to 0.3; negative values make a barrel, positive ones a pincushion.
    """

    name = "mask_distortion"
    rank = 22.6
    about = {"k": Parameter("1", 0.0, -0.3, 0.3, step=0.002, starts=(-0.05, -0.02, 0.02, 0.05))}
    sentence = "the mask's image is distorted radially by {k} in the corners"
    k: torch.Tensor

    @classmethod
    def starts(cls, frames: int, size: tuple[int, int], bit_depth: int) -> list[dict[str, Value]]:
        """Return settings by which the corners move by about a pixel, and by a few; by many in a large field."""
        corner = 0.8 / ((size[0] ** 2 + size[1] ** 2) ** 0.5 / 2)
        far = [pixels * corner for pixels in (1, 2.5, 5, 10, 20)]
        distortions = [min(k, 0.2) for k in far[:3]] + [k for k in far[3:] if k < MUCH]
        return [{"k": sign * k} for sign in (-1, 1) for k in distortions]

    def border(self, size: tuple[int, int]) -> Border:
        barrel = max(-float(self.k), 0.0)
        return Border.of_smaller(min(barrel / max(1 - 3 * barrel, 0.1), 0.5), size)
