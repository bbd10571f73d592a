"""A calibration session: the datasheet of a camera, the captures that are taken with it, and its input for them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.random_numbers import stream
from sci_lightning.virtual_camera.scene import binary, read_patterns, structural, textured_scene


@dataclass(frozen=True)
class World:
    """Patterns and scenes with what lies beyond the field, which no captures file states.

    Attributes:
        border: B, pixels on each side of the field.
        patterns: (P, H + 2 B, W + 2 B) in [0, 1]; their middle is what the modulator is commanded to display.
        scene: (N, T, H + 2 B, W + 2 B) float32 irradiance in [0, 1].
    """

    border: int
    patterns: np.ndarray
    scene: np.ndarray


@dataclass(frozen=True)
class Acquisition:
    """Everything that is set before N captures are taken.

    Attributes:
        patterns: (P, H, W) in [0, 1], the patterns in the modulator's memory.
        sequence: (N, T) index of the pattern that is commanded for every slot.
        scene: (N, T, H, W) float32 irradiance in [0, 1], also for captures whose scene the file does not state.
        aperture: (N,) scale of the light.
        exposure: (N,) integration time relative to nominal. It scales what collects without the scene's light (hot
            pixels, a light leak) and nothing else: a scene's irradiance is what arrives over its whole exposure.
        kind: N labels.
        world: patterns and scenes as they go on beyond the field; None if there is nothing but the field.

    Raises:
        BadInput: shapes that do not go together, or a sequence with indices outside the patterns.
    """

    patterns: np.ndarray
    sequence: np.ndarray
    scene: np.ndarray
    aperture: np.ndarray
    exposure: np.ndarray
    kind: tuple[str, ...]
    world: World | None = None

    def __post_init__(self) -> None:
        count, slots = self.sequence.shape
        if self.scene.shape != (count, slots, *self.patterns.shape[1:]):
            raise BadInput(
                f"scene is {self.scene.shape}, expected (N, T, H, W) = {(count, slots, *self.patterns.shape[1:])} "
                "of the sequence and the patterns"
            )
        if self.sequence.size and not 0 <= self.sequence.min() <= self.sequence.max() < len(self.patterns):
            raise BadInput(f"sequence has indices outside the patterns 0 to {len(self.patterns) - 1}")
        if self.world is not None and self.world.scene.shape[2:] != self.world.patterns.shape[1:]:
            raise BadInput("world: patterns and scene must have the same size")
        if not len(self.aperture) == len(self.exposure) == len(self.kind) == count:
            raise BadInput(f"aperture, exposure and kind must have {count} entries, one per capture")

    @property
    def border(self) -> int:
        """Pixels on each side of the field that are known of the world beyond it."""
        return 0 if self.world is None else self.world.border


SURROUNDS = ("goes_on", "dark", "edge")
"""What may lie beyond the field."""
FORMULATIONS = ("overlap", "rays")
"""Which of the two cameras takes the captures, see :func:`.rays.ray_camera.build_camera`."""
BEYOND = 12
"""Pixels of the world that are simulated beyond the field on each side."""


class PlannedCapture(NamedTuple):
    """One capture of the plan: kind, sequence (T,), a scene that broadcasts to (T, H, W), and the aperture."""

    kind: str
    sequence: np.ndarray
    scene: np.ndarray
    aperture: float


@dataclass(frozen=True)
class Session:
    """The datasheet of a camera and the list of captures to take with it; by default 34 captures.

    Attributes:
        size: (H, W) of the field in pixels, each 16 or more.
        frames: T, slots per capture.
        bit_depth: of the sensor, 8 to 16.
        mask: ``structural``, ``binary`` or the path of an .npy file with T coding patterns.
        bits: bit depth of the structural mask.
        dark: number of captures with the lens capped and every pattern off.
        flat: number of uniform scenes behind the coding patterns, irradiance 0.1 to 0.95.
        all_on, all_off: number of uniform scenes behind a pattern that is all on (aperture 1/T) or all off.
        pattern: number of uniform scenes with one coding pattern in one slot and the others off; None: one per pattern.
        static, dynamic: number of textured scenes behind the coding patterns, at rest and in motion.
        unknown: number of moving scenes that the file does not state.
        aperture: light scale of the captures behind the coding patterns; ``auto`` makes a white scene fill the range on
            average.
        dark_exposures: integration times of the dark frames relative to nominal, repeated in turn.
        full_well_e, read_noise_dn: datasheet values: electrons at full scale, and standard deviation in DN. They are
            the camera's true noise too, unless the effect ``shot_noise`` or ``read_noise`` is hidden in it.
        datasheet: whether the file states these two.
        datasheet_factor: the file states these two so many times as large as they are; 1 for a datasheet that is right.
        oversampling: cells per pixel and axis by which a rotated or blurred mask is sampled in front of blurred optics;
            everything else is exact. With 1, the light between relay and sensor counts as uniform over every pixel.
        surround: what lies beyond the field: ``goes_on`` for patterns and scenes like those inside (``BEYOND`` pixels
            on each side, then their edge repeated), ``dark``, or the ``edge`` of the field repeated.
        formulation: of the physics: ``overlap`` is a perfect set-up whose light is integrated in closed form; ``rays``
            is an imperfect one whose light is sampled, see :mod:`.rays`.

    Raises:
        BadInput: a value of another type or out of range.
    """

    size: tuple[int, int] = (128, 128)
    frames: int = 8
    bit_depth: int = 8
    mask: str = "structural"
    bits: int = 4
    dark: int = 4
    flat: int = 6
    all_on: int = 2
    all_off: int = 2
    pattern: int | None = None
    static: int = 6
    dynamic: int = 6
    unknown: int = 0
    aperture: float | str = "auto"
    dark_exposures: tuple[float, ...] = (1.0,)
    full_well_e: float = 10000.0
    read_noise_dn: float = 0.8
    datasheet: bool = True
    oversampling: int = 8
    surround: str = "goes_on"
    datasheet_factor: float = 1.0
    formulation: str = "overlap"

    def __post_init__(self) -> None:
        for name, low, high in (
            ("frames", 2, 64),
            ("bit_depth", 8, 16),
            ("bits", 1, 8),
            ("oversampling", 1, 16),
            *((kind, 0, 10000) for kind in ("dark", "flat", "all_on", "all_off", "static", "dynamic", "unknown")),
            *((("pattern", 0, 10000),) if self.pattern is not None else ()),
        ):
            _check_whole(name, getattr(self, name), low, high)
        if isinstance(self.size, str) or len(self.size) != 2:
            raise BadInput(f"size must be two numbers, height and width, got {self.size!r}")
        for side in self.size:
            _check_whole("size", side, 16, 8192)
        if not sum(self.counts.values()):
            raise BadInput("no captures: at least one of dark, flat, all_on, .. must be positive")
        if self.aperture != "auto":
            _check_positive("aperture", self.aperture)
        for name in ("full_well_e", "read_noise_dn", "datasheet_factor"):
            _check_positive(name, getattr(self, name), zero=name == "read_noise_dn")
        if not self.dark_exposures:
            raise BadInput("dark_exposures must have at least one integration time")
        for time in self.dark_exposures:
            _check_positive("dark_exposures", time)
        if self.surround not in SURROUNDS:
            raise BadInput(f"surround must be {', '.join(SURROUNDS[:-1])} or {SURROUNDS[-1]}, got {self.surround!r}")
        if self.formulation not in FORMULATIONS:
            raise BadInput(f"formulation must be {' or '.join(FORMULATIONS)}, got {self.formulation!r}")

    @property
    def counts(self) -> dict[str, int]:
        """Number of captures by the setting that asks for them."""
        names = ("dark", "flat", "all_on", "all_off", "pattern", "static", "dynamic", "unknown")
        counts = {name: getattr(self, name) for name in names}
        return {name: self.frames if count is None else count for name, count in counts.items()}

    @property
    def states_true_noise(self) -> bool:
        """Whether the file states the noise, and rightly, so that a hidden noise deviates from what it states."""
        return self.datasheet and self.datasheet_factor == 1

    @property
    def also_true(self) -> tuple[str, ...]:
        """Names that are true though nothing of the kind is hidden: of all pixels, or with a wrong datasheet."""
        wrong = ("shot_noise", "read_noise") if self.datasheet and self.datasheet_factor != 1 else ()
        return (*(("prnu",) if self.formulation == "rays" else ()), *wrong)

    @property
    def is_binary(self) -> bool:
        """Whether the coding patterns contain only 0 and 1."""
        if self.mask in ("structural", "binary"):
            return self.mask == "binary" or self.bits == 1
        return bool(np.isin(read_patterns(self.mask, self.frames, self.size), (0, 1)).all())

    def acquisition(self, seed: int) -> Acquisition:
        """Return the camera's input: patterns (the coding ones, all off, all on), scenes and exposure settings.

        Raises:
            BadInput: the file of coding patterns cannot be used.
        """
        coding = self._coding_patterns(stream(seed, "patterns"), self.size)
        automatic = {"structural": 1.0, "binary": 2 / self.frames}.get(self.mask, 1 / max(coding.sum(0).mean(), 1e-6))
        border = BEYOND if self.surround == "goes_on" else 0
        plan = list(self._plan(seed, automatic if isinstance(self.aperture, str) else float(self.aperture), border))
        height, width = (length + 2 * border for length in self.size)
        scene = np.empty((len(plan), self.frames, height, width), np.float32)
        for frames, capture in zip(scene, plan, strict=True):
            frames[:] = capture.scene
        inside = (..., slice(border, height - border), slice(border, width - border))
        patterns = _with_even(coding)
        world = World(border, _with_even(self._going_on(coding, seed)), scene) if border else None
        exposure = np.ones(len(plan), np.float32)
        exposure[: self.dark] = np.resize(self.dark_exposures, self.dark)  # the dark frames come first
        return Acquisition(
            patterns=patterns,
            sequence=np.array([capture.sequence for capture in plan], np.int64),
            scene=scene[inside],
            aperture=np.array([capture.aperture for capture in plan], np.float32),
            exposure=exposure,
            kind=tuple(capture.kind for capture in plan),
            world=world,
        )

    def _coding_patterns(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
        if self.mask == "structural":
            return structural(random, self.frames, size, self.bits)
        if self.mask == "binary":
            return binary(random, self.frames, size)
        return read_patterns(self.mask, self.frames, size)

    def _going_on(self, coding: np.ndarray, seed: int) -> np.ndarray:
        """Return the coding patterns with more of their kind beyond the field; a file's patterns are mirrored there."""
        if self.mask not in ("structural", "binary"):
            around = ((0, 0), (BEYOND, BEYOND), (BEYOND, BEYOND))
            return np.pad(coding, around, mode="reflect")
        height, width = self.size
        whole = self._coding_patterns(
            stream(seed, "patterns beyond the field"), (height + 2 * BEYOND, width + 2 * BEYOND)
        )
        whole[:, BEYOND : BEYOND + height, BEYOND : BEYOND + width] = coding
        return whole

    def _plan(self, seed: int, aperture: float, border: int) -> Iterator[PlannedCapture]:
        """Yield the captures in the order in which they are taken, dark frames first."""
        counts, slots = self.counts, self.frames
        coded, off, on = np.arange(slots), np.full(slots, slots), np.full(slots, slots + 1)
        for _ in range(self.dark):
            yield PlannedCapture("dark", off, np.array(0.0), aperture)
        for level in _levels(self.flat):
            yield PlannedCapture("flat", coded, level, aperture)
        for level in _levels(self.all_on):
            yield PlannedCapture("flat", on, level, 1 / slots)
        for level in _levels(self.all_off):
            yield PlannedCapture("pattern", off, level, 1.0)
        for number in range(counts["pattern"]):
            slot, repetition = number % slots, number // slots
            sequence = np.where(coded == slot, slot, off)
            yield PlannedCapture("pattern", sequence, np.array(0.9 / (1 + repetition)), 1.0)
        for kind in ("static", "dynamic", "unknown"):
            for number in range(counts[kind]):
                random = stream(seed, f"{kind} scene {number}")
                scene = textured_scene(random, self.size, slots, moving=kind != "static", border=border)
                yield PlannedCapture(kind, coded, scene, aperture)


def _with_even(coding: np.ndarray) -> np.ndarray:
    """Return the coding patterns, then all off, then all on; float32."""
    even = np.ones_like(coding[:1])
    return np.concatenate((coding, 0 * even, even)).astype(np.float32)


def _levels(count: int) -> np.ndarray:
    """Return irradiances spread evenly over 0.1 to 0.95; a single one lies in the middle."""
    return 0.1 + 0.85 * (np.linspace(0, 1, count) if count > 1 else np.full(count, 0.5))


def _check_whole(name: str, value: object, low: int, high: int) -> None:
    """Raise BadInput unless the value is a whole number from ``low`` to ``high``."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise BadInput(f"{name} must be a whole number from {low} to {high}, got {value!r}")


def _check_positive(name: str, value: object, *, zero: bool = False) -> None:
    """Raise BadInput unless the value is a finite, positive number, or 0 where ``zero`` allows it."""
    number = value if isinstance(value, (int, float)) and not isinstance(value, bool) else -1
    if not np.isfinite(number) or number < 0 or (number == 0 and not zero):
        raise BadInput(f"{name} must be a {'number of 0 or more' if zero else 'positive number'}, got {value!r}")
