"""Leak map: mirrors pass light that does not depend on the pattern."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.map_effect import MapEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect


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
