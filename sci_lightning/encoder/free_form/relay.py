"""Free-form deviations of the relay: where the mask's image lies, and how sharp it is."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import RelayEffect
from sci_lightning.encoder.free_form.free_form import FreeForm, NeighbourTaps, polynomials


class MaskTaps(NeighbourTaps, RelayEffect):
    """The light of every mirror also falls on its neighbours; the scene stays sharp. See :class:`NeighbourTaps`."""

    name = "mask_taps"
    rank = 27
    where = "the mask's image is smeared"

    def show(self, patterns: torch.Tensor, cells: int = 1) -> torch.Tensor:
        return self.smear(patterns, cells)


FIELD_DEGREE = 3


class MaskField(FreeForm, RelayEffect):
    """A smooth displacement field: polynomials of the position, half of the numbers for y and half for x.

    Args:
        count: 20 for polynomials up to degree 3.
        values: coefficients in pixels, of the products of Legendre polynomials.
    """

    name = "mask_field"
    rank = 26
    where = "the mask's image is distorted"
    number = Parameter("pixel", 0.0, -16, 16, step=0.05)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return (FIELD_DEGREE + 1) * (FIELD_DEGREE + 2)

    def border(self, size: tuple[int, int]) -> Border:
        down, across = self.coefficients.abs().view(2, -1).sum(1).tolist()  # Legendre polynomials are at most 1
        return Border.around(down, across)

    def show(self, patterns: torch.Tensor, cells: int = 1) -> torch.Tensor:
        height, width = patterns.shape[-2:]
        y = (torch.arange(height).to(patterns)[:, None] + 0.5) * (2 / height) - 1
        x = (torch.arange(width).to(patterns)[None] + 0.5) * (2 / width) - 1
        basis = polynomials(y, x, FIELD_DEGREE)
        down, across = self.coefficients.to(patterns).view(2, -1)
        grid = torch.stack(
            (
                x - torch.einsum("k,khw->hw", across, basis) * (2 * cells / width),
                y - torch.einsum("k,khw->hw", down, basis) * (2 * cells / height),
            ),
            -1,
        )
        return torch.nn.functional.grid_sample(patterns[None], grid[None], align_corners=False)[0]
