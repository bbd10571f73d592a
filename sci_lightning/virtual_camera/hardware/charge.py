"""Charge and voltage that cross from pixel to pixel, known from CCDs and infrared arrays. Outside the vocabulary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sci_lightning.virtual_camera.hardware.parameter import parameter
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect


@dataclass(frozen=True)
class BrighterFatter(SensorEffect):
    """Charge that has gathered repels what arrives, so that bright spots are wider than faint ones.

    Between two neighbours with charges p and q flows ``strength`` (p + q)/2 (p - q), from the fuller to the emptier;
    charges are fractions of full scale. After Antilogus et al., "The brighter-fatter effect and pixel correlations in
    CCD sensors", JINST 9 (2014): the border between pixels moves in proportion to their charge.
    """

    name = "brighter_fatter"
    strength: float = parameter("1", 0, 0.25, (0.02, 0.08), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        changed = signal.copy()
        for axis in (1, 2):
            changed += _inflow(self.strength * signal**2 / 2, axis)
        return np.maximum(changed, 0)  # more than there is cannot flow away, however bright the neighbours


@dataclass(frozen=True)
class InterPixelCapacitance(SensorEffect):
    """Each pixel's voltage couples a part ``coupling`` into each of its four neighbours, its noise included.

    After Moore, Ninkov and Forrest, "Quantum efficiency overestimation and deterministic cross talk resulting from
    interpixel capacitance", Optical Engineering 45 (2006).
    """

    name = "inter_pixel_capacitance"
    coupling: float = parameter("1", 0, 0.2, (0.008, 0.03), neutral=0.0)

    def respond(self, signal: np.ndarray, readout: Readout) -> np.ndarray:
        changed = signal.copy()
        for axis in (1, 2):
            changed += _inflow(self.coupling * signal, axis)
        return changed


def _inflow(potential: np.ndarray, axis: int) -> np.ndarray:
    """Return what every pixel receives from its two neighbours along an axis: the sum of the differences to it."""
    flow = np.diff(potential, axis=axis)  # nothing crosses the border of the field
    return np.diff(flow, axis=axis, prepend=0, append=0)
