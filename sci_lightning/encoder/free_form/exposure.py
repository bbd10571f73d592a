"""Free-form deviations of the exposure: how much light slots and captures collect."""

from __future__ import annotations

from dataclasses import replace

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ExposureEffect
from sci_lightning.encoder.exposure import Exposure
from sci_lightning.encoder.free_form.free_form import FreeForm, legendre
from sci_lightning.encoder.signal import Signal


class SlotWeights(FreeForm, ExposureEffect):
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


class SourcePower(FreeForm, ExposureEffect):
    """The light of a capture is multiplied by 1 + a polynomial of its position in the file.

    This is a property of the captures and not of the camera.

    Args:
        count: 3, for Legendre polynomials of degree 1 to 3.
        values: coefficients of the polynomials.
    """

    name = "source_power"
    rank = 34
    where = "the light drifts from capture to capture"
    number = Parameter("1", 0.0, -1, 4, step=0.005)
    of_captures = True

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return min(3, captures - 1)

    def form(self, signal: Signal) -> Signal:
        if signal.position is None:
            return signal
        moment = 2 * signal.position.to(signal.mean) / max(int(signal.position.max()), 1) - 1  # from -1 to 1
        basis = torch.stack(legendre(moment, 3)[1 : self.count + 1])
        return signal.with_mean(signal.mean * (1 + self.coefficients.to(signal.mean) @ basis)[:, None, None])
