"""The modulator: patterns in memory, and mirrors that display them slot by slot. Its effects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.effect import Effect, Maps, choice, parameter
from sci_lightning.virtual_camera.hardware.overlap import overlap
from sci_lightning.virtual_camera.random_numbers import dust_spots

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Acquisition, Session


@dataclass(frozen=True)
class ModulatorEffect(Effect):
    """Changes what the mirrors display, or when they display it."""

    stage: ClassVar[str] = "modulator"

    def display(self, patterns: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        """Return the transmittance of every pattern as it is displayed.

        Args:
            patterns: (P, H, W) transmittance so far.
            fixed_maps: the camera's own maps by the name of their effect.

        Returns:
            (P, H, W).
        """
        return patterns

    def schedule(self, slots: int) -> np.ndarray:
        """Return the mixing matrix (T, T): the part of slot t during which the pattern of slot s is displayed."""
        return np.eye(slots)


@dataclass(frozen=True)
class PatternOrder(ModulatorEffect):
    """The sequence starts ``offset`` slots late: slot t displays pattern t - offset, cyclically.

    Computed as the overlap in time of the slots with the intervals of the patterns, shifted by whole slots.
    """

    name = "pattern_order"
    offset: int = parameter("slots", -64, 64, neutral=0, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> PatternOrder:
        slots = session.frames
        return cls(int(random.choice([step for step in range(-((slots - 1) // 2), slots // 2 + 1) if step])))

    def schedule(self, slots: int) -> np.ndarray:
        return _overlap_in_time(self.offset, slots)


@dataclass(frozen=True)
class MaskOrientation(ModulatorEffect):
    """The modulator is mounted mirrored or turned. A quarter turn is counter-clockwise on the screen, as in NumPy.

    Computed by coordinates: which mirror (row, column), counted from the centre, lies at every place.
    """

    name = "mask_orientation"
    operation: str = choice(
        *("identity", "flip_lr", "flip_ud", "rot90", "rot180", "rot270", "transpose", "antitranspose"),
        neutral="identity",
    )
    # matrix from (row, column) of the image to (row, column) of the mirror, both counted from the centre
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

    def display(self, patterns: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        height, width = patterns.shape[1:]
        place = np.indices((height, width)) * 2 - np.array([height - 1, width - 1])[:, None, None]
        turned = np.einsum("ij,jyx->iyx", self.MIRROR[self.operation], place)
        row, column = (turned + np.array([height - 1, width - 1])[:, None, None]) // 2
        return patterns[:, row, column]


@dataclass(frozen=True)
class MaskLevelGamma(ModulatorEffect):
    """Grey levels are displayed wrongly, as by a liquid crystal: displayed = commanded ** gamma.

    Invisible with binary masks.
    """

    name = "mask_level_gamma"
    gamma: float = parameter("1", 0.1, 10, (0.1, 0.4), neutral=1.0, signed=True)

    @classmethod
    def is_visible_in(cls, session: Session) -> bool:
        return not session.is_binary

    def display(self, patterns: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        return patterns**self.gamma


@dataclass(frozen=True)
class MaskContrast(ModulatorEffect):
    """Mirrors that are off still pass a part ``leak`` of the light: displayed = leak + (1 - leak) * commanded."""

    name = "mask_contrast"
    leak: float = parameter("1", 0, 1, (0.02, 0.15), neutral=0.0)

    def display(self, patterns: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        on = patterns  # the part of the slot during which a mirror is on; off, it leaks
        return on * 1.0 + (1 - on) * self.leak


@dataclass(frozen=True)
class MaskLag(ModulatorEffect):
    """Mirrors settle slowly: a part ``lag`` of the light of a slot still follows what was displayed before.

    The recursion displayed_t = (1 - lag) commanded_t + lag displayed_(t-1) starts from the last slot's commanded
    pattern. It is used in its summed form: the pattern commanded k slots ago contributes lag ** k (1 - lag), and the
    starting pattern the rest.
    """

    name = "mask_lag"
    lag: float = parameter("1", 0, 0.99, (0.05, 0.3), neutral=0.0)

    def schedule(self, slots: int) -> np.ndarray:
        age = np.arange(slots)[:, None] - np.arange(slots)
        weights = np.where(age >= 0, (1 - self.lag) * self.lag ** np.maximum(age, 0), 0)
        weights[:, -1] += self.lag ** np.arange(1, slots + 1)
        return weights


@dataclass(frozen=True)
class SyncOffset(ModulatorEffect):
    """The mirrors switch ``offset`` slots late (negative: early), so that part of every slot displays a neighbour.

    The overlap in time of the slots with the shifted patterns, cyclically: late, slot t contains ``offset`` of pattern
    t - 1; early, ``-offset`` of pattern t + 1, since light cannot be negative.
    """

    name = "sync_offset"
    offset: float = parameter("slots", -0.5, 0.5, (0.06, 0.45), neutral=0.0, signed=True)

    def schedule(self, slots: int) -> np.ndarray:
        return _overlap_in_time(self.offset, slots)


@dataclass(frozen=True)
class SwappedPatterns(ModulatorEffect):
    """Two coding patterns have exchanged places in the modulator's memory. Outside the vocabulary."""

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

    def display(self, patterns: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        order = np.arange(len(patterns))
        order[[self.first, self.second]] = self.second, self.first
        return patterns[order]


@dataclass(frozen=True)
class StuckMirrors(ModulatorEffect):
    """A ``fraction`` of the mirrors no longer moves and is always on or always off. Outside the vocabulary."""

    name = "stuck_mirrors"
    fraction: float = parameter("1", 0, 1, (0.002, 0.02), neutral=0.0)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        """Return (H, W): -1 for a mirror that moves, else its constant state, 0 or 1."""
        stuck = np.full(size, -1.0)
        chosen = random.permutation(stuck.size)[: round(self.fraction * stuck.size)]
        stuck.flat[chosen] = random.integers(0, 2, len(chosen))
        return stuck

    def display(self, patterns: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        stuck = fixed_maps[self.name]
        return np.where(stuck < 0, patterns, stuck)


@dataclass(frozen=True)
class ModulatorDust(ModulatorEffect):
    """Grains on the modulator's window, a little out of focus: soft dark spots. Outside the vocabulary.

    The spots move with the mask's image; through a faultless relay they look like dust on the sensor.
    """

    name = "modulator_dust"
    depth: float = parameter("1", 0, 1, (0.2, 0.7), neutral=0.0)
    radius: float = parameter("pixel", 0.5, 64, (1.5, 4), neutral=2.5, magnitude=False)
    count: int = parameter("grains", 0, 1000, (3, 8), neutral=5, integer=True)

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        """Return the transmittance (H, W) of the window."""
        return 1 - self.depth * dust_spots(random, size, self.count, self.radius)

    def display(self, patterns: np.ndarray, fixed_maps: Maps) -> np.ndarray:
        return patterns * fixed_maps[self.name]


@dataclass(frozen=True)
class MirrorHysteresis(ModulatorEffect):
    """Mirrors open late and close in time: of every rise since the slot before, a part ``share`` is missing.

    displayed_t = commanded_t - share max(commanded_t - commanded_(t-1), 0); before the first slot lies the last one.
    Outside the vocabulary, whose lag forgets openings and closings alike.
    """

    name = "mirror_hysteresis"
    share: float = parameter("1", 0, 1, (0.04, 0.2), neutral=0.0)

    def happened(self, acquisition: Acquisition) -> Acquisition:
        if not self.share:
            return acquisition
        before = np.roll(acquisition.sequence, 1, axis=1)
        pairs, place = np.unique(
            np.stack((acquisition.sequence, before), -1).reshape(-1, 2), axis=0, return_inverse=True
        )

        def displayed(patterns: np.ndarray) -> np.ndarray:
            now, earlier = patterns[pairs[:, 0]], patterns[pairs[:, 1]]
            return now - self.share * np.maximum(now - earlier, 0)

        world = acquisition.world
        return replace(
            acquisition,
            patterns=displayed(acquisition.patterns),
            sequence=place.reshape(acquisition.sequence.shape),
            world=None if world is None else replace(world, patterns=displayed(world.patterns)),
        )


def _overlap_in_time(offset: float, slots: int) -> np.ndarray:
    """Return (T, T): the overlap of slot t with pattern s, displayed from s + offset to s + 1 + offset, cyclically."""
    whole = int(np.floor(offset))
    shares = overlap(np.arange(slots + 1.0), np.arange(-1, slots + 1) + offset - whole)
    shares[:, -1] += shares[:, 0]  # the pattern before the first one is the last one
    return np.roll(shares[:, 1:], -whole, axis=1)
