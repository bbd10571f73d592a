"""Free-form deviations of the mask: what the modulator displays, and where the relay images it."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.map_effect import MapEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect, RelayEffect
from sci_lightning.encoder.free_form.free_form import FreeForm, NeighbourTaps, piecewise_linear, polynomials


class LeakMap(MapEffect, ModulatorEffect):
    """Displayed = commanded + a number for every mirror, the same for all patterns.

    Args:
        std: standard deviation of the numbers, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "leak_map"
    rank = 18.5
    where = "single mirrors pass light whatever the pattern"
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.002, starts=(0.01,))}
    map_kind = "pixel"

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        return patterns + self.std * self.map


class LevelCurve(FreeForm, ModulatorEffect):
    """Displayed = commanded + a curve that connects the numbers, at equidistant levels from 0 to 1.

    Args:
        count: number of levels.
        values: the curve at these levels.
    """

    name = "level_curve"
    rank = 18
    where = "levels are displayed otherwise than commanded"
    number = Parameter("1", 0.0, -1, 1, step=0.005)
    count = 6

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        return patterns + piecewise_linear(patterns, self.coefficients.to(patterns))


class PatternMixing(FreeForm, ModulatorEffect):
    r"""In place of pattern p of n, :math:`M_p + \sum_q c_{p n + q} M_q` is displayed.

    Args:
        count: n squared.
        values: the mixture, row by row.
    """

    name = "pattern_mixing"
    rank = 19
    where = "patterns are displayed in the place of others, or mixed with them"
    number = Parameter("1", 0.0, -4, 4, step=0.02)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return frames * frames

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        side = round(self.count**0.5)
        coding = patterns[:side]  # fewer than T where a sequence repeats patterns
        mixture = self.coefficients.view(side, side)[: len(coding), : len(coding)].to(patterns)
        return torch.cat((coding + torch.einsum("pq,qhw->phw", mixture, coding), patterns[side:]))


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
    count = (FIELD_DEGREE + 1) * (FIELD_DEGREE + 2)

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
