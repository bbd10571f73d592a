"""The modulator: patterns in memory, mirrors that show them one slot after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.overlap import overlap
from sci_lightning.virtual_camera.hardware.parameter import choice, parameter
from sci_lightning.virtual_camera.hardware.spots import spots

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session


@dataclass(frozen=True)
class ModulatorEffect(Effect):
    """Acts on what the mirrors show, or on when they show it."""

    stage: ClassVar[str] = "modulator"

    def show(self, patterns: np.ndarray, chart: np.ndarray | None) -> np.ndarray:
        """(P, H, W) transmittance of each pattern as shown."""
        return patterns

    def schedule(self, slots: int) -> np.ndarray:
        """(T, T): how much of slot s's pattern is on the mirrors during slot t."""
        return np.eye(slots)


@dataclass(frozen=True)
class PatternOrder(ModulatorEffect):
    """The trigger of the sequence comes ``offset`` slots early or late: slot t shows pattern t - offset, cyclic.

    Formulated as the overlap in time of the slots with the patterns' own intervals, moved by whole slots.
    """

    name = "pattern_order"
    offset: int = parameter("slots", -64, 64, neutral=0, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> PatternOrder:
        slots = session.frames
        return cls(int(random.choice([step for step in range(-((slots - 1) // 2), slots // 2 + 1) if step])))

    def schedule(self, slots: int) -> np.ndarray:
        return _moved(self.offset, slots)


@dataclass(frozen=True)
class MaskOrientation(ModulatorEffect):
    """The modulator is mounted mirrored or turned. A quarter turn is counter-clockwise on the screen, as NumPy's.

    Formulated by coordinates: which mirror (row, column) lies at each place, counted from the middle.
    """

    name = "mask_orientation"
    operation: str = choice(
        *("identity", "flip_lr", "flip_ud", "rot90", "rot180", "rot270", "transpose", "antitranspose"),
        neutral="identity",
    )
    # (row, column) of the mirror from (row, column) of its image, both from the middle
    MIRROR: ClassVar[dict[str, tuple[tuple[int, int], tuple[int, int]]]] = {
        "identity": ((1, 0), (0, 1)),
        "flip_lr": ((1, 0), (0, -1)),
        "flip_ud": ((-1, 0), (0, 1)),
        "rot90": ((0, 1), (-1, 0)),
        "rot180": ((-1, 0), (0, -1)),
        "rot270": ((0, -1), (1, 0)),
        "transpose": ((0, 1), (1, 0)),
        "antitranspose": ((0, -1), (-1, 0)),
    }

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> MaskOrientation:
        square = session.size[0] == session.size[1]
        words = [word for word, turn in cls.MIRROR.items() if word != "identity" and (square or turn[0][0])]
        return cls(str(random.choice(words)))

    def check(self, session: Session) -> None:
        if session.size[0] != session.size[1] and not self.MIRROR[self.operation][0][0]:
            raise BadInput(
                f"mask_orientation.operation {self.operation} needs square masks, the size is {session.size}"
            )

    def show(self, patterns: np.ndarray, chart: np.ndarray | None) -> np.ndarray:
        height, width = patterns.shape[1:]
        place = np.indices((height, width)) * 2 - np.array([height - 1, width - 1])[:, None, None]
        turned = np.einsum("ij,jyx->iyx", self.MIRROR[self.operation], place)
        row, column = (turned + np.array([height - 1, width - 1])[:, None, None]) // 2
        return patterns[:, row, column]


@dataclass(frozen=True)
class MaskLevelGamma(ModulatorEffect):
    """Grey levels come out wrong, as with a liquid crystal: shown = told ** gamma. Invisible with binary masks."""

    name = "mask_level_gamma"
    gamma: float = parameter("1", 0.1, 10, (0.1, 0.4), neutral=1.0, signed=True)

    @classmethod
    def suits(cls, session: Session) -> bool:
        return not session.is_binary

    def show(self, patterns: np.ndarray, chart: np.ndarray | None) -> np.ndarray:
        return patterns**self.gamma


@dataclass(frozen=True)
class MaskContrast(ModulatorEffect):
    """Mirrors that are off still send a part ``leak`` of the light: shown = leak + (1 - leak) * told."""

    name = "mask_contrast"
    leak: float = parameter("1", 0, 1, (0.02, 0.15), neutral=0.0)

    def show(self, patterns: np.ndarray, chart: np.ndarray | None) -> np.ndarray:
        on = patterns  # the time a mirror is on; the rest of the slot it is off, and leaks
        return on * 1.0 + (1 - on) * self.leak


@dataclass(frozen=True)
class MaskLag(ModulatorEffect):
    """Mirrors settle slowly: a part ``lag`` of a slot's light still follows what was shown before.

    The recursion shown_t = (1 - lag) told_t + lag shown_(t-1), started from the last slot's pattern as told, summed
    up: lag ** k (1 - lag) of the pattern told k slots ago, and what is left of the start.
    """

    name = "mask_lag"
    lag: float = parameter("1", 0, 0.99, (0.05, 0.3), neutral=0.0)

    def schedule(self, slots: int) -> np.ndarray:
        age = np.arange(slots)[:, None] - np.arange(slots)
        told = np.where(age >= 0, (1 - self.lag) * self.lag ** np.maximum(age, 0), 0)
        told[:, -1] += self.lag ** np.arange(1, slots + 1)
        return told


@dataclass(frozen=True)
class SyncOffset(ModulatorEffect):
    """The mirrors switch ``offset`` slots late (negative: early), so that a part of each slot shows a neighbour.

    The overlap in time of the slots with the moved patterns: late, slot t has ``offset`` of pattern t - 1; early,
    ``-offset`` of pattern t + 1, since light cannot be negative. Cyclic.
    """

    name = "sync_offset"
    offset: float = parameter("slots", -0.5, 0.5, (0.06, 0.45), neutral=0.0, signed=True)

    def schedule(self, slots: int) -> np.ndarray:
        return _moved(self.offset, slots)


@dataclass(frozen=True)
class SwappedPatterns(ModulatorEffect):
    """Two coding patterns exchanged places in the modulator's memory. Outside the vocabulary."""

    name = "swapped_patterns"
    first: int = parameter("pattern", 0, 1023, neutral=0, integer=True)
    second: int = parameter("pattern", 0, 1023, neutral=0, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> SwappedPatterns:
        first, second = random.choice(session.frames, 2, replace=False)
        return cls(int(first), int(second))

    def check(self, session: Session) -> None:
        if max(self.first, self.second) >= session.frames:
            raise BadInput(f"swapped_patterns: the coding patterns are 0 to {session.frames - 1}")

    def show(self, patterns: np.ndarray, chart: np.ndarray | None) -> np.ndarray:
        order = np.arange(len(patterns))
        order[[self.first, self.second]] = self.second, self.first
        return patterns[order]


@dataclass(frozen=True)
class StuckMirrors(ModulatorEffect):
    """A ``fraction`` of the mirrors no longer moves: each is for ever on or for ever off. Outside the vocabulary."""

    name = "stuck_mirrors"
    fraction: float = parameter("1", 0, 1, (0.002, 0.02), neutral=0.0)

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        """(H, W): -1 for a mirror that moves, else where it stands."""
        stuck = np.full(size, -1.0)
        where = random.permutation(stuck.size)[: round(self.fraction * stuck.size)]
        stuck.flat[where] = random.integers(0, 2, len(where))
        return stuck

    def show(self, patterns: np.ndarray, chart: np.ndarray | None) -> np.ndarray:
        assert chart is not None
        return np.where(chart < 0, patterns, chart)


@dataclass(frozen=True)
class ModulatorDust(ModulatorEffect):
    """Grains on the modulator's window, a little out of focus: soft dark spots. Outside the vocabulary.

    They move with the mask's image; with a relay in order they look like dust on the sensor.
    """

    name = "modulator_dust"
    depth: float = parameter("1", 0, 1, (0.2, 0.7), neutral=0.0)
    radius: float = parameter("pixel", 0.5, 64, (1.5, 4), neutral=2.5, magnitude=False)
    count: int = parameter("grains", 0, 1000, (3, 8), neutral=5, integer=True)

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        """(H, W) transmittance."""
        return 1 - self.depth * spots(random, size, self.count, self.radius)

    def show(self, patterns: np.ndarray, chart: np.ndarray | None) -> np.ndarray:
        assert chart is not None
        return patterns * chart


def _moved(offset: float, slots: int) -> np.ndarray:
    """(T, T): overlap of slot t with pattern s, which shows from s + offset to s + 1 + offset, and every T again."""
    whole = int(np.floor(offset))
    shares = overlap(np.arange(slots + 1.0), np.arange(-1, slots + 1) + offset - whole)
    shares[:, -1] += shares[:, 0]  # the pattern before the first is the last
    return np.roll(shares[:, 1:], -whole, axis=1)
