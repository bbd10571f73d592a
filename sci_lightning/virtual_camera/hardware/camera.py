"""The camera itself: from light to numbers, through every effect that is hidden in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import reduce
from typing import TypeVar

import numpy as np

from sci_lightning.virtual_camera.hardware.converter import BitDepth, ReadNoise, ShotNoise
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.exposure import BLOCKS, ExposureEffect, Part, Timing
from sci_lightning.virtual_camera.hardware.laboratory import TargetEffect
from sci_lightning.virtual_camera.hardware.modulator import MaskOrientation, ModulatorEffect
from sci_lightning.virtual_camera.hardware.optics import Image, OpticsEffect
from sci_lightning.virtual_camera.hardware.relay import Relay, RelayEffect
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect
from sci_lightning.virtual_camera.hardware.vocabulary import EFFECTS
from sci_lightning.virtual_camera.random_numbers import stream
from sci_lightning.virtual_camera.session import Acquisition, Session

S = TypeVar("S", bound=Effect)

MOST_CELLS = 3
"""Cells per pixel and axis behind which the lens' blur may differ from cell to cell; it bounds the memory."""


class Camera:
    """One particular camera for video SCI, with its hidden effects and its own fixed-pattern maps.

    An ideal camera has shot noise, read noise and a converter as the session's datasheet states. Hidden effects are
    applied on top, in the order in which light meets them: modulator, relay, exposure, aperture, optics, sensor.

    Args:
        session: image size, datasheet and oversampling.
        effects: the hidden effects by name.
        seed: of the noise and of the camera's own maps.

    Attributes:
        effects: all effects in the order of the light's path, the ideal camera's noise and converter included.
        fixed_maps: the camera's own maps by the name of their effect, such as its per-pixel gains.
    """

    def __init__(self, session: Session, effects: Mapping[str, Effect], seed: int) -> None:
        ideal = {effect.name: effect.neutral(session) for effect in (ShotNoise, ReadNoise, BitDepth)}
        present: dict[str, Effect] = {**ideal, **effects}
        self.session = session
        self.seed = seed
        self.effects = [present[name] for name in EFFECTS if name in present]
        maps = {effect.name: effect.draw_map(stream(seed, effect.name), session.size) for effect in self.effects}
        self.fixed_maps = {name: values for name, values in maps.items() if values is not None}

    @property
    def full_scale(self) -> int:
        """The largest DN, 2**bit_depth - 1."""
        return 2**self.session.bit_depth - 1

    def record(self, acquisition: Acquisition, *, noise: bool = True) -> np.ndarray:
        """Return the captures of an acquisition: raw DN (N, H, W), with the noise of the camera's seed if ``noise``."""
        random = stream(self.seed, "noise") if noise else None
        return self.convert(self.signal(self.irradiance(acquisition), acquisition, random))

    def irradiance(self, acquisition: Acquisition) -> np.ndarray:
        """Return the light that every pixel collects over the exposure, without noise.

        The relay's image of every pattern is computed once, on cells finer than pixels. Because light is additive, the
        delays and mixtures of patterns can then be applied to the scene: every pattern is multiplied by the scene's
        light of all the moments at which it is displayed.

        Returns:
            (N, H, W) float64, 1 at full scale.
        """
        acquisition = self.happened(acquisition)
        slots = acquisition.sequence.shape[1]
        surround, border = self.session.surround, acquisition.border
        scenes = self._shown(acquisition)
        count, height, width = acquisition.patterns.shape
        relay, timing, images = self._light_path()
        parts, schedule = self._displayed(acquisition, timing)
        patterns = np.concatenate([part.patterns for part in parts])
        beyond = ((0, 0), (border, border))
        lit = [
            [(later, middle, np.pad(power, beyond, mode="edge")) for later, middle, power in one]
            for one in (timing.lit(part, slots, height) for part in parts)
        ]
        field = (slice(border, border + height), slice(border, border + width))
        captures = len(acquisition.sequence)
        power = timing.power(captures) * acquisition.aperture
        light = np.empty((captures, height, width))
        before: Relay | None = None
        for number, (sequence, scene) in enumerate(zip(acquisition.sequence, scenes, strict=True)):
            now = relay.during(number, captures)
            if now != before:
                before, (rows, columns, transmitted) = now, self._relayed(now, patterns, border, images)
                pixel_of_cell = np.ix_(rows[:-1].astype(int), columns[:-1].astype(int))
                onto_pixels = [image.onto_pixels(rows, columns, surround, border) for image in images]
            modulated = np.zeros(transmitted.shape[1:])
            for first, of_part in zip(range(0, len(patterns), count), lit, strict=True):
                pattern_light = np.tensordot(schedule, timing.met(scene, of_part), (0, 0)) * power[number]
                for pattern in np.unique(sequence):
                    lit_by = pattern_light[sequence == pattern].sum(0)[pixel_of_cell]
                    modulated += transmitted[first + pattern] * lit_by
            modulated = np.maximum(modulated, 0)  # a scene that changes evenly within a slot may fall below 0
            light[number] = np.sum([form(modulated) for form in onto_pixels], axis=0)[field]
        for effect in self._stage(OpticsEffect):
            light = effect.change_irradiance(light, acquisition.exposure, self.fixed_maps)
        return light

    def happened(self, acquisition: Acquisition) -> Acquisition:
        """Return the acquisition as it took place, which is not what the file says if something went wrong."""
        return reduce(lambda before, effect: effect.happened(before), self.effects, acquisition)

    def _light_path(self) -> tuple[Relay, Timing, list[Image]]:
        """Return the relay, the timing of the exposure and the images that the lens forms, with all their faults."""
        relay = reduce(lambda before, effect: effect.apply(before), self._stage(RelayEffect), Relay())
        timing = reduce(lambda before, effect: effect.apply(before), self._stage(ExposureEffect), Timing())
        return relay, timing, reduce(lambda before, effect: effect.apply(before), self._stage(OpticsEffect), [Image()])

    def _displayed(self, acquisition: Acquisition, timing: Timing) -> tuple[list[Part], np.ndarray]:
        """Return the patterns as displayed, in parts and beyond the field too, and in which slots (T, T)."""
        slots, world = acquisition.sequence.shape[1], acquisition.world
        height, width = acquisition.patterns.shape[1:]
        patterns = (acquisition.patterns if world is None else world.patterns).astype(np.float64)
        maps = {name: _going_on(values, acquisition.border) for name, values in self.fixed_maps.items()}
        block = np.broadcast_to(np.arange(height)[:, None] * BLOCKS // height, (height, width))
        block = _going_on(block, acquisition.border)
        modulators: list[ModulatorEffect] = self._stage(ModulatorEffect)
        parts: list[Part] = []
        for mounting in self._stage(MaskOrientation):
            block = mounting.display(block[None], maps)[0]
        for plane in timing.bit_planes(patterns):
            shown = reduce(lambda before, effect: effect.display(before, maps), modulators, plane.patterns)
            parts += timing.blocks(replace(plane, patterns=shown), block)
        return parts, reduce(lambda before, effect: effect.schedule(slots) @ before, modulators, np.eye(slots))

    def _shown(self, acquisition: Acquisition) -> np.ndarray:
        """Return the scenes (N, T, H, W) as the target shows them, beyond the field too."""
        scenes = acquisition.scene if acquisition.world is None else acquisition.world.scene
        for target in self._stage(TargetEffect):
            if target != target.neutral(self.session):
                shown = [[target.show(frame) for frame in scene] for scene in scenes.astype(np.float64)]
                scenes = np.array(shown).clip(0)
        return scenes

    def _relayed(
        self, relay: Relay, patterns: np.ndarray, border: int, images: list[Image]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the edges of the cells along y and along x, and the relay's image of every pattern on them."""
        height, width = patterns.shape[1:]
        sharp, finest = images == [Image()], self.session.oversampling
        if any(image.varies for image in images):
            finest = min(finest, MOST_CELLS)
        rows, columns = relay.cells((height, width), finest, sharp_optics=sharp)
        if sharp:  # no light from beyond the field falls on its pixels
            rows = rows[(rows >= border) & (rows <= height - border)]
            columns = columns[(columns >= border) & (columns <= width - border)]
        return rows, columns, relay.image(patterns, rows, columns, self.session.surround, border)

    def signal(
        self,
        light: np.ndarray,
        acquisition: Acquisition,
        random: np.random.Generator | None = None,
        shot_noise_sigmas: float = 0.0,
    ) -> np.ndarray:
        """Return the signal that reaches the converter.

        Args:
            light: (N, H, W) irradiance of the pixels, see :meth:`irradiance`.
            acquisition: gives the exposures.
            random: source of the noise; None for none.
            shot_noise_sigmas: without a source of noise, how many standard deviations of its shot noise are added to
                every pixel.

        Returns:
            (N, H, W), 1 at full scale.
        """
        readout = Readout(self.full_scale, acquisition.exposure, self.fixed_maps, random, shot_noise_sigmas)
        for step in self._stage(SensorEffect):
            light = step.respond(light, readout)
        return light

    def convert(self, signal: np.ndarray) -> np.ndarray:
        """Return the raw DN (N, H, W) of a signal: uint8 up to 8 bits, else uint16."""
        dtype = np.uint8 if self.session.bit_depth <= 8 else np.uint16
        return self.part(BitDepth).quantise(signal, self.full_scale).astype(dtype)

    def part(self, kind: type[S]) -> S:
        """Return the only effect of a kind that every camera has, such as ``ReadNoise``."""
        (effect,) = self._stage(kind)
        return effect

    def _stage(self, kind: type[S]) -> list[S]:
        """Return the effects of one stage, in the order of the light's path."""
        return [effect for effect in self.effects if isinstance(effect, kind)]


def _going_on(values: np.ndarray, border: int) -> np.ndarray:
    """Return a map of the field as it goes on for ``border`` pixels beyond it: its edge repeated."""
    return np.pad(values, [(border, border) if length > 1 else (0, 0) for length in values.shape], mode="edge")
