"""Pattern mixing: a mixture of patterns is displayed in place of each pattern."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect
from sci_lightning.encoder.free_form.free_form import Empirical


class PatternMixing(Empirical, ModulatorEffect):
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
