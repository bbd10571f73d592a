r"""The stages of the light's way, in order. An effect derives from the base class of the stage at which it acts.

A capture of a scene x with commanded patterns M forms as

.. math::
    D_t &= \sum_s S_{ts}\, \mathrm{show}(M_s)                  && \text{modulator: what is displayed in slot } t \\
    P_t &= \mathrm{image}(D_t;\, \mathrm{geometry})                && \text{relay: its image on the sensor} \\
    A_t &= w_t \odot \textstyle\big(P_t + \sum_s R_{ts} Q_s\big)      && \text{exposure: what multiplies frame } t \\
    \mu &= \mathrm{form}\big(a \textstyle\sum_t A_t \odot x_t\big)  && \text{optics: the image on the pixels} \\
    (m, v) &= \mathrm{respond}(\mu, 0)                         && \text{sensor: mean and variance} \\
    y &= \mathrm{round}\big(\mathrm{clip}(m + \sqrt{v}\, n)\big)    && \text{converter}

with the schedule S, the weight w of every slot (and row), the aperture a, and n drawn from a standard normal
distribution. Q is the image of what is displayed at another time within its slot, see :meth:`ExposureEffect.retimed`.
Every hook below is the identity unless an effect overrides it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import torch

from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.exposure import Exposure
from sci_lightning.encoder.relay import RelayGeometry
from sci_lightning.encoder.signal import Signal


class ModulatorEffect(Effect):
    r"""What the modulator displays: :math:`D_t = \sum_s S_{ts}\, \mathrm{show}(M_s)`."""

    stage = "modulator"

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        """Return the displayed transmittance ``(P, H, W)`` of the commanded patterns ``(P, H, W)``."""
        return patterns

    def schedule(self, slots: int) -> torch.Tensor | None:
        """Return S, ``(T, T)``: how much of slot s's pattern (column) is shown in slot t (row); None for identity."""
        return None


class RelayEffect(Effect):
    r"""How the displayed patterns are imaged onto the sensor: :math:`P_t = \mathrm{image}(D_t; \mathrm{geometry})`."""

    stage = "relay"

    def show(self, patterns: torch.Tensor, cells: int = 1) -> torch.Tensor:
        """Return the patterns ``(P, qH, qW)``, q ``cells`` a pixel, as this effect distorts or smears them."""
        return patterns

    def aim(self, geometry: RelayGeometry) -> RelayGeometry:
        """Return where the mask's image lies and how sharp it is, from where it lay without this effect."""
        return geometry


class PlacementEffect(RelayEffect):
    """A relay effect whose parameters are those of :class:`.RelayGeometry` of the same names."""

    def aim(self, geometry: RelayGeometry) -> RelayGeometry:
        return replace(geometry, **{name: getattr(self, name) for name in self.about})


class ExposureEffect(Effect):
    r"""When light is collected: :math:`A_t = w_t \odot (P_t + \sum_s R_{ts} Q_s)`."""

    stage = "exposure"

    def expose(self, exposure: Exposure) -> Exposure:
        """Return when the source shines and when each row is open, from how it was without this effect."""
        return exposure

    def retimed(self, patterns: torch.Tensor) -> torch.Tensor:
        """Return the patterns, of the same shape, whose images less those of the commanded ones are Q.

        Args:
            patterns: ``(P, H, W)`` as commanded, in rows of the modulator; ``(P, Hm, Wm)`` on a grid of their own.
        """
        return patterns

    def retiming(self, slots: int) -> torch.Tensor:
        """Return R, ``(T, T)``: how much of Q in slot s (column) is added to what multiplies frame t (row)."""
        return torch.zeros(slots, slots)

    def form(self, signal: Signal) -> Signal:
        """Return the light of whole captures; ``signal.mean`` is light without variance yet."""
        return signal


class OpticsEffect(Effect):
    r"""What the lens makes of the modulated light: :math:`\mu = \mathrm{form}(a \sum_t A_t \odot x_t)`."""

    stage = "optics"
    subpixel: ClassVar[bool] = False
    """Whether it matters where within a pixel the light falls. Such an effect may receive q x q cells per pixel
    (``signal.cells``) and returns whole pixels."""

    def form(self, signal: Signal) -> Signal:
        """Return the image on the sensor; ``signal.mean`` is light without variance yet."""
        return signal

    def undo(self, signal: Signal) -> Signal:
        """Return the measurement as it would be without this effect; unchanged where that cannot be computed."""
        return signal


class SensorEffect(Effect):
    r"""How light becomes a signal with noise: :math:`(m, v) = \mathrm{respond}(\mu, 0)`, m the mean, v the variance."""

    stage = "sensor"
    ceiling: ClassVar[str | None] = None
    """The parameter at which the signal ends, as a fraction of full scale, for an effect that limits it; its neutral
    value is 1. A diagnosis then looks for it where recorded values pile up, and treats pixels near it as censored."""
    sensor_argument: ClassVar[str | None] = None
    """The sensor's argument that says the same (``read_noise``), so that an encoder can refuse to add both up."""

    def respond(self, signal: Signal) -> Signal:
        """Return mean and variance of the signal before the converter."""
        return signal

    def undo(self, signal: Signal) -> Signal:
        """Return the measurement as it would be without this effect; unchanged where that cannot be computed."""
        return signal

    def effective_bits(self, bits: int) -> int:
        """Return how many of the converter's bits count."""
        return bits


STAGES: dict[str, type[Effect]] = {
    base.stage: base for base in (ModulatorEffect, RelayEffect, ExposureEffect, OpticsEffect, SensorEffect)
}
"""The base class of every stage, in the order in which light passes them."""
