"""Aberrations of the relay: the mirrors' image bent, or blurred in one direction. All outside the vocabulary."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sci_lightning.virtual_camera.hardware.parameter import parameter
from sci_lightning.virtual_camera.hardware.relay import Relay, RelayEffect


@dataclass(frozen=True)
class Keystone(RelayEffect):
    """The modulator is tilted towards the sensor: its image is larger at the lower end by ``tilt``, a trapezium.

    Perspective: what is seen at (x, y) from the middle is the mirror at (x, y) / (1 + 2 tilt y / H).
    """

    name = "keystone"
    tilt: float = parameter("1", -0.3, 0.3, (0.01, 0.05), neutral=0.0, signed=True)

    def misalign(self, relay: Relay) -> Relay:
        return replace(relay, keystone=self.tilt)


@dataclass(frozen=True)
class BarrelDistortion(RelayEffect):
    """Straight rows of mirrors appear bent: at radius r is seen the mirror at r (1 + strength (r / R)**2).

    R is half the diagonal; positive bends outwards, as a barrel.
    """

    name = "barrel_distortion"
    strength: float = parameter("1", -0.3, 0.3, (0.01, 0.05), neutral=0.0, signed=True)

    def misalign(self, relay: Relay) -> Relay:
        return replace(relay, barrel=self.strength)


@dataclass(frozen=True)
class MaskAstigmatism(RelayEffect):
    """The mirrors' image is blurred along x and sharp along y."""

    name = "mask_astigmatism"
    sigma: float = parameter("pixel", 0, 4, (0.4, 1.5), neutral=0.0)

    def misalign(self, relay: Relay) -> Relay:
        return replace(relay, across=self.sigma)
