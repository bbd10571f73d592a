"""Free-form deviations of the modulator: what is displayed in the place of a commanded pattern."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.map_effect import MapEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect
from sci_lightning.encoder.free_form.free_form import FreeForm, piecewise_linear


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

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return 6

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
