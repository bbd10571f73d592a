"""Faults of the laboratory: a target or single captures that are not quite what the captures file says.

Mistakes while captures were taken or filed are outside the vocabulary of a diagnosis, which should report the captures.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from scipy.ndimage import affine_transform, fourier_gaussian

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.effect import Effect, parameter

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Acquisition, Session


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


@dataclass(frozen=True)
class ProcedureEffect(Effect):
    """Changes what took place during single captures; the camera is as it should be."""

    stage: ClassVar[str] = "capture"

    @classmethod
    def is_visible_in(cls, session: Session) -> bool:
        return session.static + session.dynamic >= 2

    def check(self, session: Session) -> None:
        total = sum(session.counts.values())
        if max(self.captures, default=0) >= total:
            raise BadInput(f"{self.name}: the captures are 0 to {total - 1}, got {max(self.captures)}")


@dataclass(frozen=True)
class MislabelledCaptures(ProcedureEffect):
    """Two captures have been filed under each other's name: scenes, sequences and light of the two are exchanged."""

    name = "mislabelled_captures"
    first: int = parameter("capture", 0, 100000, neutral=0, integer=True)
    second: int = parameter("capture", 0, 100000, neutral=0, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> MislabelledCaptures:
        first, second = random.choice(textured(session), 2, replace=False)
        return cls(int(first), int(second))

    @property
    def captures(self) -> tuple[int, ...]:
        return self.first, self.second

    def happened(self, acquisition: Acquisition) -> Acquisition:
        order = np.arange(len(acquisition.sequence))
        order[[self.first, self.second]] = self.second, self.first
        changed = with_scenes(acquisition, lambda scene: scene[order])
        return replace(
            changed,
            sequence=acquisition.sequence[order],
            aperture=acquisition.aperture[order],
            exposure=acquisition.exposure[order],
        )


@dataclass(frozen=True)
class MovedCapture(ProcedureEffect):
    """Somebody leant on the table during one ``capture``: its target lies ``dx`` to the right and ``dy`` down."""

    name = "moved_capture"
    dx: float = parameter("pixel", -32, 32, (0.7, 3), neutral=0.0, signed=True)
    dy: float = parameter("pixel", -32, 32, (0.7, 3), neutral=0.0, signed=True)
    capture: int = parameter("capture", 0, 100000, neutral=0, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> MovedCapture:
        return replace(super().draw(random, session), capture=int(random.choice(textured(session))))

    @property
    def captures(self) -> tuple[int, ...]:
        return (self.capture,) if self.dx or self.dy else ()

    def happened(self, acquisition: Acquisition) -> Acquisition:
        def moved(scenes: np.ndarray) -> np.ndarray:
            scenes = scenes.copy()
            for frame in scenes[self.capture]:
                frame[:] = affine_transform(frame, np.ones(2), (-self.dy, -self.dx), order=1, mode="nearest")
            return scenes

        return with_scenes(acquisition, moved) if self.captures else acquisition


@dataclass(frozen=True)
class DroppedSlot(ProcedureEffect):
    """In one ``capture`` the modulator skipped a pattern: those after slot ``slot`` come a slot early.

    The last slot shows the first pattern again. A slot of -1 is none.
    """

    name = "dropped_slot"
    capture: int = parameter("capture", 0, 100000, neutral=0, integer=True)
    slot: int = parameter("slot", -1, 1023, neutral=-1, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> DroppedSlot:
        return cls(int(random.choice(textured(session))), int(random.integers(session.frames)))

    def check(self, session: Session) -> None:
        super().check(session)
        if self.slot >= session.frames:
            raise BadInput(f"dropped_slot.slot must be from -1 to {session.frames - 1}, got {self.slot}")

    @property
    def captures(self) -> tuple[int, ...]:
        return (self.capture,) if self.slot >= 0 else ()

    def happened(self, acquisition: Acquisition) -> Acquisition:
        if self.slot < 0:
            return acquisition
        sequence = acquisition.sequence.copy()
        row = acquisition.sequence[self.capture]
        sequence[self.capture] = np.append(np.delete(row, self.slot), row[0])
        return replace(acquisition, sequence=sequence)


def textured(session: Session) -> np.ndarray:
    """Return the indices of the textured captures whose scene the file states; all captures if they are fewer."""
    before = sum(session.counts[name] for name in ("dark", "flat", "all_on", "all_off", "pattern"))
    count = session.static + session.dynamic
    return before + np.arange(count) if count > 1 else np.arange(max(sum(session.counts.values()), 2))


def with_scenes(acquisition: Acquisition, change: Callable[[np.ndarray], np.ndarray]) -> Acquisition:
    """Return the acquisition with its scenes (N, T, H, W) changed, beyond the field too where they go on there."""
    if acquisition.world is None:
        return replace(acquisition, scene=change(acquisition.scene))
    return replace(acquisition, world=replace(acquisition.world, scene=change(acquisition.world.scene)))
