"""The exposure: what is displayed when, how the source shines, and when every row is exposed. Its effects."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.effect import Effect, choice, parameter
from sci_lightning.virtual_camera.random_numbers import stream

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session

BLOCKS = 16
"""Blocks of rows of the modulator that may change their patterns one after the other."""


@dataclass(frozen=True)
class Part:
    """What some of the mirrors display, or all of them for a part of their slots.

    Attributes:
        patterns: (P, H, W) transmittance; 0 of the other mirrors.
        start, stop: slots from the beginning of the slot to which a pattern belongs.
    """

    patterns: np.ndarray
    start: float = 0.0
    stop: float = 1.0


@dataclass(frozen=True)
class Timing:
    """Timing of the exposure, in slots from the moment at which the first row opens.

    Attributes:
        delay: slots between the start of the first row's exposure and that of the last row's.
        amplitude, frequency, phase: the source shines as 1 + amplitude sin(2 pi frequency s / T + phase).
        duty: part of every slot during which its pattern is shown; dark in between.
        slot, loss: slot number ``slot`` is dark for its last part ``loss``, in every repetition of the sequence.
        drift: relative change of the source's power from the first to the last capture.
        uneven: standard deviation of the light of the slots, and the seed of its random values.
        unsteady: standard deviation of the light of the captures, and the seed of its random values.
        reset: slots between the changes of the first and the last block of the modulator's rows.
        planes: ``msb_first`` or ``lsb_first`` where gray levels are displayed as bit planes, else ``none``.
    """

    delay: float = 0.0
    amplitude: float = 0.0
    frequency: float = 1.0
    phase: float = 0.0
    duty: float = 1.0
    slot: int = 0
    loss: float = 0.0
    drift: float = 0.0
    uneven: tuple[float, int] = (0.0, 0)
    unsteady: tuple[float, int] = (0.0, 0)
    reset: float = 0.0
    planes: str = "none"

    def bit_planes(self, patterns: np.ndarray) -> list[Part]:
        """Return patterns (P, H, W) of gray levels plane by plane; as they are if they are not displayed in planes.

        The levels are the multiples of 1 / 2**b, or of 1 / (2**b - 1), for the smallest b of 1 to 8. All planes of a
        mirror are so bright that their light together is that of its level.
        """
        counts = [(bits, full) for bits in range(1, 9) for full in (2**bits, 2**bits - 1)]
        fitting = [one for one in counts if np.abs(patterns * one[1] - np.rint(patterns * one[1])).max() < 1e-3]
        if self.planes == "none" or not fitting:
            return [Part(patterns)]
        bits, full = fitting[0]
        level = np.minimum(np.rint(patterns * full), 2**bits - 1).astype(int)
        brightness = patterns * (2**bits - 1) / np.maximum(level, 1)
        digits = [2**bit for bit in range(bits)]
        lengths = np.array(digits if self.planes == "lsb_first" else digits[::-1])
        stops = lengths.cumsum() / (2**bits - 1)
        return [
            Part(np.where(level // length % 2 == 1, brightness, 0), float(stop - length / (2**bits - 1)), float(stop))
            for length, stop in zip(lengths, stops, strict=True)
        ]

    def blocks(self, part: Part, block: np.ndarray) -> list[Part]:
        """Return a part block by block, as the blocks change one after the other.

        Args:
            part: of the patterns.
            block: (H, W) to which every mirror belongs, 0 to 15.
        """
        if not self.reset:
            return [part]
        late = self.reset / (BLOCKS - 1)
        return [
            Part(part.patterns * (block == number), part.start + number * late, part.stop + number * late)
            for number in range(BLOCKS)
        ]

    def lit(self, part: Part, slots: int, rows: int) -> Iterator[tuple[int, float, np.ndarray]]:
        """Yield when a part is displayed: slots after its own, the middle within that slot, and the light (K, H)."""
        for later in range(math.floor(part.start), math.ceil(part.stop)):
            start, stop = max(part.start - later, 0.0), min(part.stop - later, 1.0)
            yield later, (start + stop) / 2, self.slot_light(slots, rows, start, stop)

    def met(self, scene: np.ndarray, lit: list[tuple[int, float, np.ndarray]]) -> np.ndarray:
        """Return the light (T, H, W) of a scene that meets the patterns of a part, slot by slot.

        Behind bit planes a scene moves within a slot: a frame is its mean over the slot, within which it changes
        evenly, by half the difference of the frames before and after, at either end by that from the only neighbour.

        Args:
            scene: (T, H, W).
            lit: see :meth:`lit`, with a row of light for every row of the scene.
        """
        slots, met = len(scene), np.zeros(scene.shape)
        change = self.change(scene)
        for later, middle, light in lit:
            frames = scene if change is None else scene + (middle - 0.5) * change
            for slot, row_light in enumerate(light):
                frame = frames[slot] if slot < slots else scene[-1]
                met[(slot - later) % slots] += row_light[:, None] * frame
        return met

    def change(self, scene: np.ndarray) -> np.ndarray | None:
        """Return by how much a scene (T, H, W) changes from the beginning to the end of every slot; None: it rests."""
        return None if self.planes == "none" else np.gradient(scene.astype(np.float64), axis=0)

    def slot_light(self, slots: int, rows: int, begin: float = 0.0, end: float = 1.0) -> np.ndarray:
        """Return the light that every row collects during every slot, 1 for the ideal camera.

        The source's power is integrated in closed form over the time that slot and row have in common.

        Args:
            slots: T, slots per capture.
            rows: H, rows of the sensor.
            begin, end: the part of every slot that counts.

        Returns:
            (K, H), K >= T; with a delay, the last rows are still exposed after slot T.
        """
        opens = np.linspace(0, self.delay, rows)
        slot = np.arange(slots + math.ceil(self.delay))[:, None]
        start = np.maximum(slot + begin, opens)
        shown = np.minimum(np.minimum(self.duty, 1 - self.loss * (slot % slots == self.slot)), end)
        stop = np.minimum(slot + shown, opens + slots)
        stop = np.maximum(start, stop)
        rate = 2 * np.pi * self.frequency / slots
        swing = np.cos(rate * start + self.phase) - np.cos(rate * stop + self.phase)
        level = self.slot_levels(slots)[slot % slots]
        return level * np.maximum(stop - start + self.amplitude / rate * swing, 0)  # rounding may leave -1e-16

    def slot_levels(self, slots: int) -> np.ndarray:
        """Return the relative light (T,) of the slots, in every repetition of the sequence."""
        return _random_levels(*self.uneven, slots)

    def power(self, captures: int) -> np.ndarray:
        """Return the relative power (N,) of the source during each of N captures."""
        return (1 + self.drift * np.linspace(-0.5, 0.5, captures)) * _random_levels(*self.unsteady, captures)


def _random_levels(deviation: float, seed: int, length: int) -> np.ndarray:
    """Return (length,) Gaussian numbers with exactly mean 1 and the given standard deviation, clipped at 0."""
    numbers = stream(seed, "course").standard_normal(length)
    spread = numbers.std() if length > 1 else 1.0
    return np.maximum(1 + deviation * (numbers - numbers.mean()) / spread, 0)


@dataclass(frozen=True)
class ExposureEffect(Effect):
    """Changes the amount of light over time."""

    stage: ClassVar[str] = "exposure"

    def apply(self, timing: Timing) -> Timing:
        """Return the timing with this fault, whose parameters are attributes of the timing unless it says otherwise."""
        return replace(timing, **vars(self))


@dataclass(frozen=True)
class Flicker(ExposureEffect):
    """The source flickers: 1 + amplitude sin(2 pi frequency s / T + phase), s in slots from the exposure's start.

    Every slot collects the integral, so that fast flicker averages out within a slot.
    """

    name = "flicker"
    amplitude: float = parameter("1", 0, 1, (0.05, 0.3), neutral=0.0)
    frequency: float = parameter("cycles per exposure", 0.01, 1000, (0.5, 3), neutral=1.0, magnitude=False)
    phase: float = parameter("rad", -2 * math.pi, 2 * math.pi, (-math.pi, math.pi), neutral=0.0, magnitude=False)


@dataclass(frozen=True)
class RollingShutter(ExposureEffect):
    """Row r starts and ends its exposure delay * r / (H - 1) slots late.

    Meanwhile the patterns go on cyclically and the source shines on; the last frame of the scene stays.
    """

    name = "rolling_shutter"
    delay: float = parameter("slots", 0, 64, (0.2, 1.5), neutral=0.0)


@dataclass(frozen=True)
class DutyCycle(ExposureEffect):
    """Every pattern is shown from the start of its slot for ``fraction`` of it; it is dark until the next one.

    Under steady light this is the same as a smaller gain.
    """

    name = "duty_cycle"
    fraction: float = parameter("1", 0.01, 1, (0.05, 0.3), neutral=1.0)

    def apply(self, timing: Timing) -> Timing:
        return replace(timing, duty=self.fraction)


@dataclass(frozen=True)
class PhasedReset(ExposureEffect):
    """Sixteen blocks of the modulator's rows change one after the other, the last one ``delay`` slots after the first.

    Every block is displayed by itself, from its own moment on, and meets the light of that moment.
    """

    name = "phased_reset"
    delay: float = parameter("slots", 0, 1, (0.05, 0.5), neutral=0.0)

    def apply(self, timing: Timing) -> Timing:
        return replace(timing, reset=self.delay)


@dataclass(frozen=True)
class BitPlanes(ExposureEffect):
    """Gray levels are displayed as binary planes, 2**k parts of the slot long, between which the scene moves on.

    Every plane is displayed by itself, before the scene of its own moment, see :meth:`Timing.light`. Invisible with
    binary masks and with scenes at rest.
    """

    name = "bit_planes"
    order: str = choice("none", "msb_first", "lsb_first", neutral="none")

    @classmethod
    def is_visible_in(cls, session: Session) -> bool:
        return not session.is_binary and session.dynamic > 0

    def apply(self, timing: Timing) -> Timing:
        return replace(timing, planes=self.order)


@dataclass(frozen=True)
class ShortSlot(ExposureEffect):
    """One slot of the sequence is dark for its last part, ``loss`` of a slot. Outside the vocabulary."""

    name = "short_slot"
    loss: float = parameter("slots", 0, 1, (0.05, 0.4), neutral=0.0)
    slot: int = parameter("slot", 0, 1023, neutral=0, integer=True)

    @classmethod
    def draw(cls, random: np.random.Generator, session: Session) -> ShortSlot:
        return replace(super().draw(random, session), slot=int(random.integers(session.frames)))

    def check(self, session: Session) -> None:
        if self.slot >= session.frames:
            raise BadInput(f"short_slot.slot must be from 0 to {session.frames - 1}, got {self.slot}")


@dataclass(frozen=True)
class DriftingSource(ExposureEffect):
    """The lamp warms up: its power changes linearly by ``drift`` over the captures. Outside the vocabulary."""

    name = "drifting_source"
    drift: float = parameter("1", -1, 1, (0.03, 0.15), neutral=0.0, signed=True)


@dataclass(frozen=True)
class UnevenSlots(ExposureEffect):
    """The slots differ in light by Gaussian amounts, the same in every capture. Outside the vocabulary.

    ``course`` is the seed of the amounts.
    """

    name = "uneven_slots"
    std: float = parameter("1", 0, 0.5, (0.02, 0.1), neutral=0.0)
    course: int = parameter("", 0, 2**31 - 1, (0, 2**31 - 1), neutral=0, integer=True)

    def apply(self, timing: Timing) -> Timing:
        return replace(timing, uneven=(self.std, self.course))


@dataclass(frozen=True)
class UnsteadySource(ExposureEffect):
    """The source's power, or the shutter, varies at random from capture to capture. Outside the vocabulary.

    ``course`` is the seed of the powers.
    """

    name = "unsteady_source"
    std: float = parameter("1", 0, 0.5, (0.01, 0.05), neutral=0.0)
    course: int = parameter("", 0, 2**31 - 1, (0, 2**31 - 1), neutral=0, integer=True)

    def apply(self, timing: Timing) -> Timing:
        return replace(timing, unsteady=(self.std, self.course))
