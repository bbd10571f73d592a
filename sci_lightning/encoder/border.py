"""The border of the field: pixels whose value depends on what lies beyond the field."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numpy as np

SAFETY = 0.1
"""Pixels by which a border may grow before it has one row more than it was rounded up to."""
TAIL = 3.7
"""Standard deviations of a blur beyond which a ten-thousandth of the light falls."""


@dataclass(frozen=True)
class Border:
    """How far what lies beyond the field reaches into it, in pixels from each side; 0 where it does not.

    Attributes:
        top, right, bottom, left: pixels, 0 or more.
    """

    top: float = 0.0
    right: float = 0.0
    bottom: float = 0.0
    left: float = 0.0

    @staticmethod
    def around(down: float, across: float | None = None) -> Border:
        """Return the border that is ``down`` pixels wide at top and bottom, and ``across`` at left and right."""
        across = down if across is None else across
        return Border(down, across, down, across)

    @staticmethod
    def of_displacement(dx: float, dy: float) -> Border:
        """Return the border of an image that has moved by (dx, dy) pixels, +x right and +y down."""
        return Border(top=max(dy, 0.0), right=max(-dx, 0.0), bottom=max(-dy, 0.0), left=max(dx, 0.0))

    @staticmethod
    def of_smaller(part: float, size: tuple[int, int]) -> Border:
        """Return the border of an image that is smaller by a ``part`` than a field of ``size`` (H, W)."""
        return Border.around(max(part, 0.0) * size[0] / 2, max(part, 0.0) * size[1] / 2)

    @staticmethod
    def of_blur(sigma: float) -> Border:
        """Return the border of an image that is blurred by a Gaussian of standard deviation ``sigma`` pixels."""
        return Border.around(TAIL * sigma)

    @staticmethod
    def outside(inside: np.ndarray) -> Border:
        """Return the border around a rectangle of pixels that are all ``inside`` ``(H, W)``, in whole pixels.

        One side after the other is taken off, always that of which the largest part is not inside.
        """
        top, left, bottom, right = 0, 0, *inside.shape
        while top < bottom and left < right:
            sides = (
                inside[top, left:right],
                inside[top:bottom, right - 1],
                inside[bottom - 1, left:right],
                inside[top:bottom, left],
            )
            shares = [float(side.mean()) for side in sides]
            worst = int(np.argmin(shares))
            if shares[worst] == 1:
                break
            top, right = top + (worst == 0), right - (worst == 1)
            bottom, left = bottom - (worst == 2), left + (worst == 3)
        return Border(top, inside.shape[1] - right, inside.shape[0] - bottom, left)

    def __add__(self, other: Border) -> Border:
        """Return the border of two effects one after the other."""
        return Border(*(mine + its for mine, its in zip(astuple(self), astuple(other), strict=True)))

    def __or__(self, other: Border) -> Border:
        """Return the smallest border that contains both."""
        return Border(*(max(mine, its) for mine, its in zip(astuple(self), astuple(other), strict=True)))

    def contains(self, other: Border) -> bool:
        """Return whether the other border is nowhere wider."""
        return self | other == self

    def rounded(self) -> Border:
        """Return the border in whole pixels, with a little room to grow."""
        return Border(*(math.ceil(side + SAFETY) if side > 0 else 0 for side in astuple(self)))

    def limited(self, size: tuple[int, int], share: float) -> Border:
        """Return the border with at most ``share`` of the field's side taken from either of two opposite sides."""
        down, across = (math.floor(share * length) for length in size)
        return Border(min(self.top, down), min(self.right, across), min(self.bottom, down), min(self.left, across))

    def window(self, size: tuple[int, int]) -> tuple[slice, slice]:
        """Return the rows and columns of a field of ``size`` that lie inside a border of whole pixels."""
        height, width = size
        return slice(int(self.top), height - int(self.bottom)), slice(int(self.left), width - int(self.right))
