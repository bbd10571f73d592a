"""A calibration session: the camera's datasheet and the captures that are taken with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.patterns import binary, read_patterns, structural
from sci_lightning.virtual_camera.scene import textured_scene
from sci_lightning.virtual_camera.shots import Shots
from sci_lightning.virtual_camera.stream import stream

Shot: TypeAlias = tuple[str, np.ndarray, np.ndarray, float]
"""Kind, sequence (T,), scene (T, H, W) or one that broadcasts to it, aperture."""


@dataclass(frozen=True)
class Session:
    """An ideal camera and 34 captures, unless told otherwise.

    Attributes:
        size: (H, W), 16 or more each.
        frames: T, slots per capture.
        bit_depth: 8 to 16.
        mask: ``structural``, ``binary`` or an .npy file of T patterns.
        bits: of the structural mask.
        dark: captures with the cap on and every pattern off.
        flat: even scenes behind the coding patterns, 0.1 to 0.95.
        all_on, all_off: even scenes behind patterns all on (aperture 1/T) or all off.
        pattern: even scenes, one slot showing one coding pattern and the others off; None: one for each pattern.
        static, dynamic: textures at rest and on the move, behind the coding patterns.
        unknown: as dynamic, but the file does not tell the scene.
        aperture: of the captures behind the coding patterns; ``auto``: a white scene fills the range on average.
        dark_exposures: integration times of the dark frames, in turn.
        full_well_e, read_noise_dn: the datasheet: electrons at full scale, standard deviation in DN. The camera's true
            noise too, unless the effect shot_noise or read_noise is hidden in it.
        datasheet: whether the file states them.
        oversampling: cells per pixel and axis in which a turned or blurred mask meets a blurred lens; everything else
            is exact. 1: light between relay and sensor counts as even over each pixel.
        surround: what lies beyond the field: ``dark``, or the ``edge`` going on.

    Raises:
        BadInput: any of them out of range.
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
    surround: str = "dark"

    def __post_init__(self) -> None:
        for name, low, high in (
            ("frames", 2, 64),
            ("bit_depth", 8, 16),
            ("bits", 1, 8),
            ("oversampling", 1, 16),
            *((kind, 0, 10000) for kind in ("dark", "flat", "all_on", "all_off", "static", "dynamic", "unknown")),
            *((("pattern", 0, 10000),) if self.pattern is not None else ()),
        ):
            _whole(name, getattr(self, name), low, high)
        if isinstance(self.size, str) or len(self.size) != 2:
            raise BadInput(f"size must be two numbers, height and width, got {self.size!r}")
        for side in self.size:
            _whole("size", side, 16, 8192)
        if not sum(self.counts.values()):
            raise BadInput("no captures: at least one of dark, flat, all_on, .. must be positive")
        if self.aperture != "auto":
            _positive("aperture", self.aperture)
        for name in ("full_well_e", "read_noise_dn"):
            _positive(name, getattr(self, name), zero=name == "read_noise_dn")
        if not self.dark_exposures:
            raise BadInput("dark_exposures must have at least one integration time")
        for time in self.dark_exposures:
            _positive("dark_exposures", time)
        if self.surround not in ("dark", "edge"):
            raise BadInput(f"surround must be dark or edge, got {self.surround!r}")

    @property
    def counts(self) -> dict[str, int]:
        """How many captures of each sort."""
        names = ("dark", "flat", "all_on", "all_off", "pattern", "static", "dynamic", "unknown")
        counts = {name: getattr(self, name) for name in names}
        return {name: self.frames if count is None else count for name, count in counts.items()}

    @property
    def is_binary(self) -> bool:
        """Whether the coding patterns are made of 0 and 1 only."""
        if self.mask in ("structural", "binary"):
            return self.mask == "binary" or self.bits == 1
        return bool(np.isin(read_patterns(self.mask, self.frames, self.size), (0, 1)).all())

    def shots(self, seed: int) -> Shots:
        """Everything before the camera: patterns (the coding ones, all off, all on), scenes, apertures."""
        coding = self._coding(stream(seed, "patterns"))
        patterns = np.concatenate((coding, np.zeros((1, *self.size)), np.ones((1, *self.size)))).astype(np.float32)
        automatic = {"structural": 1.0, "binary": 2 / self.frames}.get(self.mask, 1 / max(coding.sum(0).mean(), 1e-6))
        shots = list(self._plan(seed, automatic if isinstance(self.aperture, str) else float(self.aperture)))
        scene = np.empty((len(shots), self.frames, *self.size), np.float32)
        for capture, shot in zip(scene, shots, strict=True):
            capture[:] = shot[2]
        kind = tuple(shot[0] for shot in shots)
        exposure = np.ones(len(shots), np.float32)
        exposure[: self.dark] = np.resize(self.dark_exposures, self.dark)  # the dark frames come first
        aperture = np.array([shot[3] for shot in shots], np.float32)
        return Shots(patterns, np.array([shot[1] for shot in shots], np.int64), scene, aperture, exposure, kind)

    def _coding(self, random: np.random.Generator) -> np.ndarray:
        if self.mask == "structural":
            return structural(random, self.frames, self.size, self.bits)
        if self.mask == "binary":
            return binary(random, self.frames, self.size)
        return read_patterns(self.mask, self.frames, self.size)

    def _plan(self, seed: int, aperture: float) -> Iterator[Shot]:
        counts, slots = self.counts, self.frames
        coded, off, on = np.arange(slots), np.full(slots, slots), np.full(slots, slots + 1)
        for _ in range(self.dark):
            yield "dark", off, np.array(0.0), aperture
        for level in _levels(self.flat):
            yield "flat", coded, level, aperture
        for level in _levels(self.all_on):
            yield "flat", on, level, 1 / slots
        for level in _levels(self.all_off):
            yield "pattern", off, level, 1.0
        for number in range(counts["pattern"]):
            slot, turn = number % slots, number // slots
            yield "pattern", np.where(coded == slot, slot, off), np.array(0.9 / (1 + turn)), 1.0
        for kind in ("static", "dynamic", "unknown"):
            for number in range(counts[kind]):
                random = stream(seed, f"{kind} scene {number}")
                yield kind, coded, textured_scene(random, self.size, slots, moving=kind != "static"), aperture


def _levels(count: int) -> np.ndarray:
    """Irradiances spread evenly over 0.1 to 0.95; a single one in the middle."""
    return 0.1 + 0.85 * (np.linspace(0, 1, count) if count > 1 else np.full(count, 0.5))


def _whole(name: str, value: object, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise BadInput(f"{name} must be a whole number from {low} to {high}, got {value!r}")


def _positive(name: str, value: Any, *, zero: bool = False) -> None:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not np.isfinite(value) or value < 0 or (value == 0 and not zero):
        raise BadInput(f"{name} must be a {'number of 0 or more' if zero else 'positive number'}, got {value!r}")
