"""Stray light: light that does not pass the mask."""

from __future__ import annotations

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.free_form.free_form import Empirical
from sci_lightning.encoder.free_form.shading import DEGREE, smooth
from sci_lightning.encoder.signal import Signal


class StrayLight(Empirical, OpticsEffect):
    """The light plus a polynomial of the position that grows with the integration time, in dark captures as well.

    Args:
        count: 15 for polynomials up to degree 4.
        values: coefficients of the products of Legendre polynomials, by degree, fraction of full scale.
    """

    name = "stray_light"
    rank = 46
    where = "light reaches the sensor that does not come from the scene"
    number = Parameter("1", 0.0, -1, 1, step=0.001)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return (DEGREE + 1) * (DEGREE + 2) // 2

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        return signal.with_mean(signal.mean + signal.exposure * smooth(signal, self.coefficients, DEGREE, True))
