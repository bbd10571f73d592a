"""Level curve: the displayed level as a free function of the commanded level."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect
from sci_lightning.encoder.free_form.free_form import Empirical, piecewise_linear


class LevelCurve(Empirical, ModulatorEffect):
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
