"""Mask keystone: the modulator is seen at an angle, so that its image is a trapezium."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.encoder.effects.stage import PlacementEffect


class MaskKeystone(PlacementEffect):
    """Perspective: the magnification differs by ``tilt_x`` at the right edge, by ``tilt_y`` at the lower edge.

    It differs as much, with the other sign, at the opposite edges. The place that is seen at (x, y) from the field's
    centre is the one at (x, y) / (1 + 2 tilt_x x / W + 2 tilt_y y / H).

    Args:
        tilt_x, tilt_y: -0.3 to 0.3.
    """

    name = "mask_keystone"
    rank = 22.4
    about = {
        name: Parameter("1", 0.0, -0.3, 0.3, step=0.002, starts=(-0.02, 0.0, 0.02)) for name in ("tilt_x", "tilt_y")
    }
    sentence = "the magnification of the mask's image changes by {tilt_x} to the right and {tilt_y} to the lower edge"
    tilt_x: torch.Tensor
    tilt_y: torch.Tensor

    @classmethod
    def starts(cls, frames: int, size: tuple[int, int], bit_depth: int) -> list[dict[str, Value]]:
        """Return settings by which the edges move by about a pixel, and by a few."""
        edge = 1.6 / max(size)
        steps = (-2.5, -1.0, 0.0, 1.0, 2.5)
        return [
            {"tilt_x": across * edge, "tilt_y": down * edge} for across in steps for down in steps if across or down
        ]

    def border(self, size: tuple[int, int]) -> Border:
        (height, width), x, y = size, float(self.tilt_x), float(self.tilt_y)
        aside, up = abs(y) * width / 2, abs(x) * height / 2
        return Border(
            top=up + max(y, 0.0) * height / 2,
            bottom=up + max(-y, 0.0) * height / 2,
            left=aside + max(x, 0.0) * width / 2,
            right=aside + max(-x, 0.0) * width / 2,
        )
