"""Slot weights: some slots of the exposure count more than others."""

from __future__ import annotations

from dataclasses import replace

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ExposureEffect
from sci_lightning.encoder.exposure import Exposure
from sci_lightning.encoder.free_form.free_form import Empirical


class SlotWeights(Empirical, ExposureEffect):
    """Slot t collects 1 + c_t times its nominal light.

    Args:
        count: T.
        values: c.
    """

    name = "slot_weights"
    rank = 33
    where = "slots of one exposure collect more or less light than others"
    number = Parameter("1", 0.0, -1, 4, step=0.005)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return frames

    def expose(self, exposure: Exposure) -> Exposure:
        weight = 1 + self.coefficients.to(exposure.power)
        return replace(
            exposure,
            power=exposure.power * weight.repeat(1 + len(exposure.power) // self.count)[: len(exposure.power), None],
        )
