"""Mistakes while the captures were taken or filed: single captures that are not what the file says.

All of them are outside the vocabulary of a diagnosis, which should report the captures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from scipy.ndimage import affine_transform

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.parameter import parameter

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.acquisition import Acquisition
    from sci_lightning.virtual_camera.session import Session


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
