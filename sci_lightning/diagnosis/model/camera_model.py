"""A hypothesis about the camera, and what it predicts for every capture."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch

from sci_lightning.diagnosis.model.ceiling import Ceiling
from sci_lightning.diagnosis.model.likelihood import LEAST_DEVIATION
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.encoder.effects import Effect, MapEffect, OpticsEffect, SensorEffect
from sci_lightning.encoder.effects.parameter import Value
from sci_lightning.encoder.effects.stage import ExposureEffect, ModulatorEffect, RelayEffect
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.signal import Signal

Setting = dict[str, Value]


@dataclass(frozen=True)
class Hypothesis:
    """Effects by name: the values of their parameters, and the maps of those that have one.

    Attributes:
        effects: values by parameter, by effect.
        charts: ``(H, W)``, ``(1, W)`` or ``(H, 1)`` maps by effect, in the effect's own unit.
    """

    effects: dict[str, Setting]
    charts: dict[str, torch.Tensor] = field(default_factory=dict)

    def having(self, name: str, setting: Setting, chart: torch.Tensor | None = None) -> Hypothesis:
        """The same with an effect set so; its chart stays, unless one is given."""
        charts = self.charts if chart is None else {**self.charts, name: chart}
        return Hypothesis({**self.effects, name: dict(setting)}, charts)

    def without(self, name: str) -> Hypothesis:
        """The same without an effect."""
        effects = {each: values for each, values in self.effects.items() if each != name}
        return Hypothesis(effects, {each: chart for each, chart in self.charts.items() if each != name})


@dataclass(frozen=True)
class Prediction:
    """Mean and standard deviation of every pixel before the converter, ``(N, H, W)`` in DN, and its effective bits.

    Where signal ends before the converter does, ``ceiling`` says how it is distributed there.
    """

    mean: torch.Tensor
    deviation: torch.Tensor
    bits: int
    ceiling: Ceiling | None = None


class CameraModel:
    """Predicts captures from hypotheses.

    What light does before the sensor is remembered for the last few hypotheses: fits change one parameter at a time.

    Args:
        observation: the captures.
        vocabulary: every effect that may be named, by name. Others may be put into ``known``.
        memory: how many light fields to remember.
    """

    def __init__(self, observation: Observation, vocabulary: Mapping[str, type[Effect]], memory: int = 3) -> None:
        self.observation = observation
        self.vocabulary = dict(vocabulary)
        self.known = dict(vocabulary)
        self._memory = memory
        self._modulated: OrderedDict[Any, Any] = OrderedDict()
        self._formed: OrderedDict[Any, Any] = OrderedDict()

    def starts(self, name: str, hypothesis: Hypothesis) -> list[Setting]:
        """Where a search for an effect sets out; a ceiling of the signal also from where pixels have piled up."""
        seen, effect = self.observation, self.known[name]
        found = effect.starts(seen.frames, seen.size, seen.bit_depth)
        if parameter := _ceiling_parameter(effect):
            behind = self._behind(self.path(hypothesis), effect)
            levels = (self._before(behind, level) for level in seen.pile_ups)
            found += [{parameter: level} for level in levels if 0 < level < 1]
        return found

    def adding(
        self, hypothesis: Hypothesis, name: str, setting: Setting, chart: torch.Tensor | None = None
    ) -> Hypothesis:
        """The hypothesis with one more effect. If signal ends, then where it is recorded to end now: that is plain."""
        found = hypothesis.having(name, setting, chart)
        for other in hypothesis.effects:
            parameter = _ceiling_parameter(self.known[other])
            if parameter and self.known[name].rank > self.known[other].rank:
                level = torch.full((1, *self.observation.size), float(hypothesis.effects[other][parameter]))
                recorded = self._recorded(self._behind(self.path(hypothesis), self.known[other]), level)
                level_before = self._before(self._behind(self.path(found), self.known[other]), recorded)
                found = found.having(other, {**found.effects[other], parameter: level_before})
        return found

    def _behind(self, path: LightPath, effect: type[Effect]) -> LightPath:
        return LightPath(each for each in path.of(SensorEffect) if each.rank > effect.rank)

    def _before(self, behind: LightPath, recorded: float) -> float:
        """The signal that is recorded as so much behind some effects of the sensor, by bisection."""
        low, high, one = 0.0, 1.0, torch.ones(1, *self.observation.size)
        for _ in range(24):
            middle = (low + high) / 2
            low, high = (low, middle) if self._recorded(behind, middle * one) > recorded else (middle, high)
        return (low + high) / 2

    def _recorded(self, behind: LightPath, even: torch.Tensor) -> float:
        exposure = torch.ones(1, 1, 1)
        signal = Signal(even, torch.zeros(()), exposure, 1 / self.observation.full_scale, (0, 0), self.observation.size)
        return float(behind.respond(signal).mean.median())

    def blank_chart(self, name: str) -> torch.Tensor | None:
        """The map of an effect, all 0; None for an effect without one."""
        effect = self.known[name]
        return torch.zeros(effect.shape(self.observation.size)) if issubclass(effect, MapEffect) else None

    def path(self, hypothesis: Hypothesis) -> LightPath:
        """The hypothesis as modules."""
        effects = []
        for name, values in hypothesis.effects.items():
            effect = self.known[name](**values)
            if isinstance(effect, MapEffect):
                _fill(effect, hypothesis.charts.get(name), self.observation.size)
            effects.append(effect)
        return LightPath(effects)

    @torch.no_grad()
    def predict(self, hypothesis: Hypothesis) -> Prediction:
        """Mean and deviation of every pixel; see :class:`Prediction`."""
        seen, path = self.observation, self.path(hypothesis)
        early = tuple(
            _key(effect) for effect in (*path.of(ModulatorEffect), *path.of(RelayEffect), *path.of(ExposureEffect))
        )
        lens = tuple(_key(effect) for effect in path.of(OpticsEffect))
        formed = self._recall(self._formed, (early, path.cells, lens), lambda: self._form(path, early))
        light = replace(formed, variance=torch.zeros(()))
        mean, deviation = self._in_dn(path.respond(light))
        return Prediction(mean, deviation, path.effective_bits(seen.bit_depth), self._ceiling(path, light))

    def _ceiling(self, path: LightPath, light: Signal) -> Ceiling | None:
        effects = path.of(SensorEffect)
        limits = {effect: getattr(effect, effect.ceiling) for effect in effects if effect.ceiling}
        ends = [effect for effect, level in limits.items() if float(level) < 1]
        if not ends:
            return None
        open_ = self._in_dn(LightPath(each for each in effects if each not in ends).respond(light))
        behind = self._behind(path, type(ends[0]))
        full = light.with_mean(limits[ends[0]] * torch.ones_like(light.mean))
        return Ceiling(*open_, *self._in_dn(behind.respond(full)))

    def _in_dn(self, signal: Signal) -> tuple[torch.Tensor, torch.Tensor]:
        deviation = signal.variance.sqrt() * self.observation.full_scale
        deviation = deviation.expand_as(signal.mean).clamp(min=LEAST_DEVIATION)
        return signal.mean * self.observation.full_scale, deviation

    def _form(self, path: LightPath, early: tuple[Any, ...]) -> Signal:
        modulated = self._recall(self._modulated, (early, path.cells), lambda: self._modulate(path))
        return path.form(modulated)

    def _modulate(self, path: LightPath) -> Signal:
        seen, cells = self.observation, path.cells
        shown = path.images(seen.patterns)
        images: list[torch.Tensor] = [torch.zeros(())] * len(seen)
        for which, sequence in enumerate(seen.sequences):  # one after the other: all masks at once are too large
            masks = path.during(shown, sequence[None])[0]
            total = None
            for number in (seen.sequence == which).nonzero()[:, 0].tolist():
                scene = seen.scene[number]
                if scene.shape[0] == 1:  # at rest: the masks may be added up first
                    total = masks.sum(0) if total is None else total
                    images[number] = total * _fine(scene, cells)[0]
                elif scene.shape[1:] == (1, 1):
                    images[number] = torch.einsum("thw,t->hw", masks, scene[:, 0, 0])
                else:
                    images[number] = (masks * _fine(scene, cells)).sum(0)
        light = torch.stack(images) * seen.aperture
        return Signal(light, torch.zeros(()), seen.exposure, 1 / seen.full_scale, (0, 0), seen.size, cells, seen.number)

    def _recall(self, memory: OrderedDict[Any, Any], key: Any, make: Any) -> Any:
        if key not in memory:
            memory[key] = make()
            if len(memory) > self._memory:
                memory.popitem(last=False)
        memory.move_to_end(key)
        return memory[key]


def _ceiling_parameter(effect: type[Effect]) -> str | None:
    """Return the parameter at which the signal ends, for an effect of the sensor that limits it."""
    return effect.ceiling if issubclass(effect, SensorEffect) else None


def _fill(effect: MapEffect, chart: torch.Tensor | None, size: tuple[int, int]) -> None:
    """Give the effect its map: in units of its standard deviation, where it has one."""
    shape = effect.shape(size)
    if chart is None:
        effect.map = torch.zeros(shape)
    elif "std" in effect.about:
        effect.map = chart / max(float(effect.std), 1e-12)
    else:
        effect.map = chart


def _key(effect: Effect) -> Any:
    chart = effect.map.sum().item() if isinstance(effect, MapEffect) else None
    return (effect.name, tuple(effect.values.items()), chart)


def _fine(scene: torch.Tensor, cells: int) -> torch.Tensor:
    return scene if cells == 1 else scene.repeat_interleave(cells, -1).repeat_interleave(cells, -2)
