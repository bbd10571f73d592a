"""The target in front of the camera: it is not quite what the captures file says. Faults of the laboratory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from scipy.ndimage import affine_transform, fourier_gaussian

from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.parameter import parameter

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session


@dataclass(frozen=True)
class TargetEffect(Effect):
    """Changes what the target shows; the camera is as it should be."""

    stage: ClassVar[str] = "scene"

    @classmethod
    def is_visible_in(cls, session: Session) -> bool:
        return session.static + session.dynamic > 0

    def show(self, frame: np.ndarray) -> np.ndarray:
        """Return a frame (H, W) of the target as it is, from how the file says that it is."""
        return frame


@dataclass(frozen=True)
class SceneShift(TargetEffect):
    """The targets lie ``dx`` to the right and ``dy`` further down."""

    name = "scene_shift"
    dx: float = parameter("pixel", -32, 32, (0.15, 1.5), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -32, 32, (0.15, 1.5), neutral=0.0, signed=True)

    def show(self, frame: np.ndarray) -> np.ndarray:
        return affine_transform(frame, np.ones(2), (-self.dy, -self.dx), order=3, mode="nearest")


@dataclass(frozen=True)
class SceneRotation(TargetEffect):
    """The targets are turned about the middle of the field, positive from +x to +y: clockwise on the screen."""

    name = "scene_rotation"
    angle: float = parameter("degree", -45, 45, (0.15, 1.2), neutral=0.0, signed=True)

    def show(self, frame: np.ndarray) -> np.ndarray:
        cos, sin = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
        return _about_the_middle(frame, np.array([[cos, -sin], [sin, cos]]))


@dataclass(frozen=True)
class SceneScale(TargetEffect):
    """The targets are ``scale`` times as large, about the middle of the field."""

    name = "scene_scale"
    scale: float = parameter("1", 0.5, 2, (0.003, 0.02), neutral=1.0, signed=True)

    def show(self, frame: np.ndarray) -> np.ndarray:
        return _about_the_middle(frame, np.eye(2) / self.scale)


@dataclass(frozen=True)
class SceneBlur(TargetEffect):
    """The targets are blurred by a Gaussian of ``sigma`` pixels."""

    name = "scene_blur"
    sigma: float = parameter("pixel", 0, 8, (0.4, 1.2), neutral=0.0)

    def show(self, frame: np.ndarray) -> np.ndarray:
        around = int(5 * self.sigma) + 1
        blurred = fourier_gaussian(np.fft.fft2(np.pad(frame, around, mode="symmetric")), self.sigma)
        return np.fft.ifft2(blurred).real[around:-around, around:-around]


@dataclass(frozen=True)
class SceneGamma(TargetEffect):
    """Brightness is shown as its power of ``gamma``, in even scenes too."""

    name = "scene_gamma"
    gamma: float = parameter("1", 0.1, 10, (0.03, 0.2), neutral=1.0, signed=True)

    @classmethod
    def is_visible_in(cls, session: Session) -> bool:
        return True

    def show(self, frame: np.ndarray) -> np.ndarray:
        return frame**self.gamma


def _about_the_middle(frame: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return the frame of which (row, column) from the middle is the one at ``matrix`` times it."""
    middle = (np.array(frame.shape) - 1) / 2
    return affine_transform(frame, matrix, middle - matrix @ middle, order=3, mode="nearest")
