"""Faults of the relay: the image of the mirrors is displaced, turned, magnified, distorted or blurred.

The last two (astigmatism and thermal drift) are outside the vocabulary of a diagnosis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from sci_lightning.virtual_camera.hardware.parameter import parameter
from sci_lightning.virtual_camera.hardware.relay import Relay, RelayEffect


@dataclass(frozen=True)
class MaskShift(RelayEffect):
    """The mirrors' image lies ``dx`` to the right and ``dy`` further down: exact overlap of squares with pixels."""

    name = "mask_shift"
    dx: float = parameter("pixel", -32, 32, (0.15, 1.5), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -32, 32, (0.15, 1.5), neutral=0.0, signed=True)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, dx=self.dx, dy=self.dy)


@dataclass(frozen=True)
class MaskRotation(RelayEffect):
    """The mirrors' image is turned about its centre, positive from +x to +y: clockwise on the screen."""

    name = "mask_rotation"
    angle: float = parameter("degree", -45, 45, (0.15, 1.2), neutral=0.0, signed=True)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, angle=math.radians(self.angle))


@dataclass(frozen=True)
class MaskScale(RelayEffect):
    """The mirrors' image is ``scale`` times as large, about its centre: exact overlap of squares with pixels."""

    name = "mask_scale"
    scale: float = parameter("1", 0.5, 2, (0.003, 0.02), neutral=1.0, signed=True)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, scale=self.scale)


@dataclass(frozen=True)
class MaskBlur(RelayEffect):
    """The mirrors are out of focus, the scene is not: squares blurred by a Gaussian, integrated in closed form."""

    name = "mask_blur"
    sigma: float = parameter("pixel", 0, 4, (0.25, 1.2), neutral=0.0)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, sigma=self.sigma)


@dataclass(frozen=True)
class MaskKeystone(RelayEffect):
    """The modulator is tilted: its image is larger at the right edge by ``tilt_x`` and at the lower one by ``tilt_y``.

    Perspective: the mirror seen at (x, y) from the centre is the one at (x, y) / (1 + 2 tilt_x x / W + 2 tilt_y y / H).
    """

    name = "mask_keystone"
    tilt_x: float = parameter("1", -0.3, 0.3, (0.006, 0.03), neutral=0.0, signed=True)
    tilt_y: float = parameter("1", -0.3, 0.3, (0.006, 0.03), neutral=0.0, signed=True)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, tilt_x=self.tilt_x, tilt_y=self.tilt_y)


@dataclass(frozen=True)
class MaskDistortion(RelayEffect):
    """Straight rows of mirrors appear bent: what belongs at radius r is seen at r (1 + k (r / R)**2).

    R is half the diagonal of the field; negative values make a barrel.
    """

    name = "mask_distortion"
    k: float = parameter("1", -0.3, 0.3, (0.01, 0.05), neutral=0.0, signed=True)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, k=self.k)


@dataclass(frozen=True)
class MaskAstigmatism(RelayEffect):
    """The mirrors' image is blurred along x and sharp along y."""

    name = "mask_astigmatism"
    sigma: float = parameter("pixel", 0, 4, (0.4, 1.5), neutral=0.0)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, sigma_x=self.sigma)


@dataclass(frozen=True)
class MaskDrift(RelayEffect):
    """The mount warms up: the mirrors' image moves evenly by (``dx``, ``dy``) from the first to the last capture.

    Halfway it lies where it should.
    """

    name = "mask_drift"
    dx: float = parameter("pixel", -32, 32, (0.2, 0.8), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -32, 32, (0.2, 0.8), neutral=0.0, signed=True)

    def apply(self, relay: Relay) -> Relay:
        return replace(relay, drift_x=self.dx, drift_y=self.dy)
