"""The virtual camera: light to numbers, through every effect that is hidden in it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from typing import TypeVar

import numpy as np

from sci_lightning.virtual_camera.hardware.converter import BitDepth, ReadNoise, ShotNoise
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.exposure import ExposureEffect, Timing
from sci_lightning.virtual_camera.hardware.modulator import ModulatorEffect
from sci_lightning.virtual_camera.hardware.optics import Image, OpticsEffect
from sci_lightning.virtual_camera.hardware.relay import Relay, RelayEffect
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect
from sci_lightning.virtual_camera.hardware.vocabulary import EFFECTS
from sci_lightning.virtual_camera.session import Session
from sci_lightning.virtual_camera.shots import Shots
from sci_lightning.virtual_camera.stream import stream

S = TypeVar("S", bound=Effect)


class VirtualCamera:
    """A camera for video SCI that is not as its datasheet says.

    An ideal one has shot noise, read noise and a converter as the session states; hidden effects come on top, in the
    order light meets them: modulator, relay, exposure, aperture, optics, sensor.

    Args:
        session: size, datasheet, oversampling.
        effects: by name, what to hide.
        seed: of the noise and of the maps that are this camera's own (``charts``).
    """

    def __init__(self, session: Session, effects: Mapping[str, Effect], seed: int) -> None:
        ideal = {step.name: step.neutral(session) for step in (ShotNoise, ReadNoise, BitDepth)}
        present: dict[str, Effect] = {**ideal, **effects}
        self.session = session
        self.seed = seed
        self.effects = [present[name] for name in EFFECTS if name in present]
        charts = {each.name: each.chart(stream(seed, each.name), session.size) for each in self.effects}
        self.charts = {name: chart for name, chart in charts.items() if chart is not None}

    def light(self, shots: Shots) -> np.ndarray:
        """Irradiance of every pixel over the exposure, (N, H, W) float64, 1 at full scale; no noise yet.

        What the relay makes of a pattern is worked out once per pattern, on cells finer than pixels. Light being
        additive, delays and mixtures of patterns are then moved to the scene: each pattern gets the scene's light of
        all the moments that show it.
        """
        slots = shots.sequence.shape[1]
        patterns = shots.patterns.astype(np.float64)
        shown = np.eye(slots)
        for mirrors in self.of(ModulatorEffect):
            patterns = mirrors.show(patterns, self.charts.get(mirrors.name))
            shown = mirrors.schedule(slots) @ shown
        relay = reduce(lambda before, effect: effect.misalign(before), self.of(RelayEffect), Relay())
        timing = reduce(lambda before, effect: effect.disturb(before), self.of(ExposureEffect), Timing())
        images = reduce(lambda before, effect: effect.form(before), self.of(OpticsEffect), [Image()])

        rows, columns = relay.cells(self.session.size, self.session.oversampling, sharp=images == [Image()])
        transmitted = relay.image(patterns, rows, columns, self.session.surround)
        pixel = np.ix_(rows[:-1].astype(int), columns[:-1].astype(int))  # that each cell lies in
        weights = timing.light(slots, self.session.size[0])
        power = timing.power(len(shots.sequence)) * shots.aperture
        light = np.empty((len(shots.sequence), *self.session.size))
        for number, (sequence, scene) in enumerate(zip(shots.sequence, shots.scene, strict=True)):
            during = np.zeros(scene.shape)
            for slot, weight in enumerate(weights):
                during[slot % slots] += weight[:, None] * scene[min(slot, slots - 1)]
            through = np.tensordot(shown, during, (0, 0)) * power[number]
            modulated = np.zeros(transmitted.shape[1:])
            for pattern in np.unique(sequence):
                modulated += transmitted[pattern] * through[sequence == pattern].sum(0)[pixel]
            light[number] = sum(image.collect(modulated, rows, columns, self.session.surround) for image in images)
        for effect in self.of(OpticsEffect):
            light = effect.fall(light, shots.exposure)
        return light

    def signal(
        self, light: np.ndarray, shots: Shots, random: np.random.Generator | None = None, deviations: float = 0.0
    ) -> np.ndarray:
        """What reaches the converter, (N, H, W), 1 at full scale.

        Without ``random`` there is no noise in it, but shot noise of so many standard ``deviations`` everywhere.
        """
        readout = Readout(self.full_scale, shots.exposure, random, deviations)
        for step in self.of(SensorEffect):
            if not isinstance(step, BitDepth):
                light = step.respond(light, readout, self.charts.get(step.name))
        return light

    def convert(self, signal: np.ndarray) -> np.ndarray:
        """Raw DN (N, H, W), uint8 up to 8 bits, else uint16."""
        (converter,) = self.of(BitDepth)
        level = converter.respond(signal, Readout(self.full_scale, np.ones(len(signal))), None)
        return np.rint(level * self.full_scale).astype(np.uint8 if self.session.bit_depth <= 8 else np.uint16)

    def record(self, shots: Shots, *, noise: bool = True) -> np.ndarray:
        """The captures: raw DN (N, H, W)."""
        return self.convert(self.signal(self.light(shots), shots, stream(self.seed, "noise") if noise else None))

    @property
    def full_scale(self) -> int:
        """The largest DN."""
        return 2**self.session.bit_depth - 1

    def of(self, stage: type[S]) -> list[S]:
        """The effects of one stage, in order."""
        return [effect for effect in self.effects if isinstance(effect, stage)]
