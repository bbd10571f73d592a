"""The forward model: a hypothesis about the camera, and what it predicts for every capture."""

from __future__ import annotations

import copy
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import torch

from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.diagnosis.model.imperfections import ErrorOfLight
from sci_lightning.diagnosis.model.likelihood import MIN_DEVIATION_DN, ClippedSignal, PixelLikelihood, Prediction
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.model.recent import Recent
from sci_lightning.diagnosis.model.smooth_basis import quadrants
from sci_lightning.diagnosis.target_effects import SceneDetail, SceneEffect, changed_scenes
from sci_lightning.encoder import free_form
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import Effect, MapEffect, OpticsEffect, SensorEffect
from sci_lightning.encoder.effects.stage import ExposureEffect, ModulatorEffect, RelayEffect
from sci_lightning.encoder.free_form import FreeForm
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.signal import Signal
from sci_lightning.operator import SnapshotOperator

REMEMBERED_MODULES = 1000
"""Effects with their parameters that are kept as modules: a search tries the same ones again and again."""
REMEMBERED_LIGHT_FIELDS = 3
"""Light fields that are kept at least: most parameters belong to the sensor, so that a fit needs few at a time."""
REMEMBERED_LIGHT_BYTES = 200_000_000
"""Memory of the images that are kept: what one look at all effects predicts serves the next, from the same camera."""
MASK_VALUES_AT_A_TIME = 8_000_000
"""Values of what multiplies the frames that are computed at a time, 4 bytes each."""
MAP_STEP = 1e-3
"""Change of a map's values over which the derivative of the mean is taken."""


@dataclass(frozen=True)
class Evaluated:
    """A hypothesis and how well it explains the captures.

    Attributes:
        hypothesis: about the camera.
        prediction: of every pixel that counts.
        likelihood: of these pixels, with its derivatives.
        objective: log-likelihood of the fitted pixels, penalised by prior and uncertainty of the maps, nats; None where
            it is not known yet.
    """

    hypothesis: Hypothesis
    prediction: Prediction
    likelihood: PixelLikelihood
    objective: float | None = None


class CameraModel:
    """Predicts captures from hypotheses.

    The light before the sensor is remembered for the last few hypotheses: most parameters belong to the sensor.

    Args:
        observation: the captures.
        vocabulary: every effect that may be named, by name.
        free_forms: effects that a hypothesis may contain beside them, by name: free-form deviations; None for those
            that these captures can determine.
        imperfections: errors of the laboratory that a hypothesis may contain, all together, by name; None for none.
    """

    def __init__(
        self,
        observation: Observation,
        vocabulary: Mapping[str, type[Effect]],
        free_forms: Mapping[str, type[Effect]] | None = None,
        imperfections: Mapping[str, type[Effect]] | None = None,
    ) -> None:
        self.observation = observation
        self.vocabulary = dict(vocabulary)
        self.free_forms = free_forms_for(observation) if free_forms is None else dict(free_forms)
        self.imperfections = dict(imperfections or {})
        self.effects: Mapping[str, type[Effect]] = {**self.free_forms, **self.imperfections, **self.vocabulary}
        self.window = Border().window(observation.size)
        self._recorded_before = self._in_window(observation.before)
        self._lit = _lit(observation.scene)
        self._modules: Recent[Effect] = Recent(REMEMBERED_MODULES)
        self._scenes: Recent[list[torch.Tensor]] = Recent(REMEMBERED_LIGHT_FIELDS)
        self._images: Recent[torch.Tensor] = Recent(1)
        self._modulated: Recent[Signal] = Recent(REMEMBERED_LIGHT_FIELDS)
        image_bytes = 4 * observation.dn.numel()
        self._formed: Recent[Signal] = Recent(max(REMEMBERED_LIGHT_FIELDS, REMEMBERED_LIGHT_BYTES // image_bytes))
        self._light_slopes: Recent[tuple[torch.Tensor, Prediction]] = Recent(1)

    def of_captures(self, observation: Observation) -> CameraModel:
        """Return a new model of the same camera for other captures."""
        return CameraModel(observation, self.vocabulary, self.free_forms, self.imperfections)

    def with_imperfections(self, hypothesis: Hypothesis) -> Hypothesis:
        """Return a hypothesis with the errors of the laboratory that it lacks, where a fit of them should start."""
        for name, effect in self.imperfections.items():
            if name not in hypothesis.effects:
                start: Setting = {parameter: about.starts[0] for parameter, about in effect.about.items()}
                hypothesis = hypothesis.with_effect(name, start, self.zero_map(name))
        return hypothesis

    def inside(self, border: Border, stride: int = 1) -> CameraModel:
        """Return the same model whose predictions are those of the pixels inside a border of whole pixels.

        Light is predicted for the whole field and remembered by both models alike.

        Args:
            border: pixels along the sides that are left out.
            stride: every so many rows and columns are predicted.
        """
        view = copy.copy(self)
        view.window = border.window(self.observation.size)
        if stride > 1:
            rows, columns = (slice(part.start, part.stop, stride) for part in view.window)
            view.window = rows, columns
        view._recorded_before = view._in_window(self.observation.before)
        return view

    def windowed(self, field: torch.Tensor) -> torch.Tensor:
        """Return the predicted pixels' part of a field ``(.., H, W)``, ``(.., 1, W)`` or ``(.., H, 1)``."""
        rows, columns = self._parts(field.shape[-2:])
        return field[..., rows, columns].contiguous()

    def _in_window(self, dn: torch.Tensor | None) -> torch.Tensor | None:
        """Return raw DN as fractions of full scale at the predicted pixels."""
        return None if dn is None else self.windowed(dn) / self.observation.full_scale

    def whole(self, values: torch.Tensor) -> torch.Tensor:
        """Return a field like that of :meth:`windowed` as one of the whole field, 0 at all other pixels."""
        size = [full if part > 1 else 1 for part, full in zip(values.shape[-2:], self.observation.size, strict=True)]
        rows, columns = self._parts(size)
        padded = torch.zeros(*values.shape[:-2], *size, dtype=values.dtype)
        padded[..., rows, columns] = values
        return padded

    def _parts(self, size: Sequence[int]) -> list[slice]:
        """Return the window's rows and columns; all of an axis along which a field of this size is the same."""
        return [part if length > 1 else slice(None) for part, length in zip(self.window, size, strict=True)]

    def zero_map(self, name: str) -> torch.Tensor | None:
        """Return the fixed-pattern map of an effect with every value 0; None for an effect without a map."""
        effect = self.effects[name]
        return torch.zeros(effect.shape(self.observation.size)) if issubclass(effect, MapEffect) else None

    @property
    def _origin(self) -> tuple[int, int]:
        """(row, column) of the first predicted pixel in the maps of the sensor's effects, see :meth:`path`."""
        rows, columns = self.window
        return (0, 0) if rows.step or columns.step else (rows.start, columns.start)

    def path(self, hypothesis: Hypothesis) -> LightPath:
        """Return the camera of a hypothesis as modules, in the order in which light meets them.

        Maps of the sensor's effects are those of the predicted pixels where these do not lie side by side.
        """
        effects = []
        for name, setting in hypothesis.effects.items():
            if issubclass(self.effects[name], SceneEffect):
                continue
            effect = self._module(name, setting)
            if isinstance(effect, MapEffect):
                values = hypothesis.maps.get(name)
                if values is not None and isinstance(effect, SensorEffect) and self.window[0].step:
                    values = self.windowed(values)
                _set_map(effect, values, self.observation.size)
            effects.append(effect)
        detailed = any(issubclass(self.effects[name], SceneDetail) for name in hypothesis.effects)
        return LightPath(effects, self.observation.grid, detailed)

    def target_effects(self, hypothesis: Hypothesis) -> list[SceneEffect]:
        """Return by which effects the targets of a hypothesis differ from what the file says, in order."""
        effects = [
            self._module(name, setting)
            for name, setting in hypothesis.effects.items()
            if issubclass(self.effects[name], SceneEffect)
        ]
        return sorted((effect for effect in effects if isinstance(effect, SceneEffect)), key=lambda effect: effect.rank)

    def _module(self, name: str, setting: Setting) -> Effect:
        """Return an effect with its parameters; a new one if it has a map, which changes."""
        effect = self.effects[name]
        if effect.map_kind:
            return effect(**setting)
        return self._modules.get((name, tuple(setting.items())), lambda: effect(**setting))

    @torch.no_grad()
    def scenes(self, hypothesis: Hypothesis) -> list[torch.Tensor]:
        """Return the scenes of all captures as they are by a hypothesis; shapes as in the observation."""
        effects = self.target_effects(hypothesis)
        if not effects:
            return self.observation.scene

        def change() -> list[torch.Tensor]:
            scenes = self.observation.scene
            for effect in effects:
                scenes = changed_scenes(effect, scenes)
            return scenes

        return self._scenes.get(tuple(effect_key(effect) for effect in effects), change)

    def border(self, hypothesis: Hypothesis) -> Border:
        """Return how far what lies beyond the patterns reaches into the field, if that is unknown; else 0."""
        if self.observation.dark_surround:
            return Border()
        size = self.observation.size
        of_targets = (effect.border(size) for effect in self.target_effects(hypothesis))
        return sum(of_targets, self.path(hypothesis).border(size))

    @torch.no_grad()
    def predict(self, hypothesis: Hypothesis) -> Prediction:
        """Predict mean and standard deviation of every pixel of every capture, of those in the window."""
        path = self.path(hypothesis)
        before_lens = (*path.of(ModulatorEffect), *path.of(RelayEffect), *path.of(ExposureEffect))
        shown = tuple(effect_key(effect) for effect in self.target_effects(hypothesis))
        modulation = shown, tuple(effect_key(effect) for effect in before_lens), path.cells
        optics = tuple(effect_key(effect) for effect in path.of(OpticsEffect))

        def form() -> Signal:
            return path.form(self._modulated.get(modulation, lambda: self._modulate(path, hypothesis)))

        light = self._formed.get((modulation, optics), form)
        light = replace(light, mean=self.windowed(light.mean), variance=torch.zeros(()), origin=self._origin)
        light = replace(light, recorded_before=self._recorded_before)
        mean, deviation = self._in_dn(path.respond(light))
        bits = path.effective_bits(self.observation.bit_depth)
        return Prediction(mean, deviation, bits, self._clipped(path, light), self.window)

    def map_jacobian(self, hypothesis: Hypothesis, name: str, prediction: Prediction) -> torch.Tensor:
        """Return the derivative ``(N, H, W)`` of the mean with respect to an effect's map, at each pixel's own value.

        Args:
            hypothesis: need not contain the effect yet; its map is then taken at 0.
            name: of an effect with a map.
            prediction: of the hypothesis.
        """
        effect = self.effects[name]
        if issubclass(effect, ErrorOfLight):
            slope, _ = self._light_slopes.get(id(prediction), lambda: self._light_slope(hypothesis, prediction))
            return slope * effect.concerned[self.observation.position][:, None, None]
        values = self.map_values(hypothesis, name)
        neutral_scale: Setting = {
            parameter: 1.0 if parameter == "std" else 0.5 for parameter in self.effects[name].about
        }
        # The mean light must stay the same behind a smooth map: glare would spread the difference over the image.
        smooth = self.effects[name].map_kind == "smooth"
        step = MAP_STEP * quadrants(values.shape) if smooth else MAP_STEP
        shifted = self.predict(hypothesis.with_effect(name, neutral_scale, values + step))
        if name not in hypothesis.effects or name not in hypothesis.maps:
            prediction = self.predict(hypothesis.with_effect(name, neutral_scale, values))
        return (shifted.mean - prediction.mean) / (self.windowed(step) if isinstance(step, torch.Tensor) else step)

    def _light_slope(self, hypothesis: Hypothesis, prediction: Prediction) -> tuple[torch.Tensor, Prediction]:
        """Return the derivative ``(N, H, W)`` of a prediction's mean by a relative change of the light, and itself."""
        name, values = "exposure_jitter", self.map_values(hypothesis, "exposure_jitter")
        shifted = self.predict(hypothesis.with_effect(name, {"std": 1.0}, values + MAP_STEP))
        return (shifted.mean - prediction.mean) / MAP_STEP, prediction

    def map_values(self, hypothesis: Hypothesis, name: str) -> torch.Tensor:
        """Return the values of an effect's map in a hypothesis, 0 where it has none yet.

        Raises:
            ValueError: an effect without a map.
        """
        values = hypothesis.maps.get(name, self.zero_map(name))
        if values is None:
            raise ValueError(f"effect {name} has no fixed-pattern map")
        return values

    def _clipped(self, path: LightPath, light: Signal) -> ClippedSignal | None:
        """Return how the signal is distributed if it saturates below full scale."""
        effects = path.of(SensorEffect)
        limits = {effect: getattr(effect, effect.ceiling) for effect in effects if effect.ceiling}
        limiting = [effect for effect, level in limits.items() if float(level) < 1]
        if not limiting:
            return None
        unclipped = LightPath(effect for effect in effects if effect not in limiting)
        after = behind(path, type(limiting[0]))
        full = light.with_mean(limits[limiting[0]] * torch.ones_like(light.mean))
        return ClippedSignal(*self._in_dn(unclipped.respond(light)), *self._in_dn(after.respond(full)))

    def _in_dn(self, signal: Signal) -> tuple[torch.Tensor, torch.Tensor]:
        """Return mean and standard deviation of a signal in DN."""
        deviation = signal.variance.sqrt() * self.observation.full_scale
        deviation = deviation.expand_as(signal.mean).clamp(min=MIN_DEVIATION_DN)
        return signal.mean * self.observation.full_scale, deviation

    def _modulate(self, path: LightPath, hypothesis: Hypothesis) -> Signal:
        """Return the light of every capture behind the modulator: the sum over the slots of mask times scene."""
        observation, cells, scenes = self.observation, path.cells, self.scenes(hypothesis)
        detail = next((one for one in self.target_effects(hypothesis) if isinstance(one, SceneDetail)), None)
        key = tuple(effect_key(effect) for effect in path.imaging), cells
        shown = self._images.get(key, lambda: path.images(observation.patterns))
        light = torch.zeros(len(observation), *shown.shape[-2:])
        lit = self._lit if scenes is observation.scene else _lit(scenes)
        for masks, numbers in self._masks(path, shown, lit):
            # cells are many: they are added up slot by slot, without memory for every slot's product
            operator, total = SnapshotOperator(masks, cells if detail is None else 1, slot_by_slot=cells > 1), None
            even = [number for number in numbers if scenes[number].shape[1:] == (1, 1)]
            if even:
                light[even] = operator.uniform_scene(torch.stack([scenes[number][:, 0, 0] for number in even]))
            for number in (one for one in numbers if one not in even):
                scene = scenes[number] if detail is None else detail.on_cells(scenes[number], cells)
                if scene.shape[0] == 1:  # the scene is at rest, so that the masks may be summed first
                    total = operator.total() if total is None else total
                    light[number] = operator.static_scene(scene, total)[0]
                else:
                    light[number] = operator(scene[None])[0]
        light *= observation.aperture
        return Signal(
            light,
            torch.zeros(()),
            observation.exposure,
            1 / observation.full_scale,
            (0, 0),
            observation.size,
            cells,
            observation.position,
        )

    def _masks(
        self, path: LightPath, shown: torch.Tensor, lit: torch.Tensor
    ) -> Iterator[tuple[torch.Tensor, list[int]]]:
        """Yield what multiplies the frames in every sequence, ``(T, qH, qW)``, and the captures that are lit in it.

        Some sequences are computed at a time: those of all captures do not fit in memory.
        """
        observation = self.observation
        captures = [
            (which, ((observation.sequence == which) & lit).nonzero()[:, 0].tolist())
            for which in range(len(observation.sequences))
        ]
        captures = [(which, numbers) for which, numbers in captures if numbers]
        at_a_time = max(1, MASK_VALUES_AT_A_TIME // (observation.frames * shown[0].numel()))
        for first in range(0, len(captures), at_a_time):
            some = captures[first : first + at_a_time]
            masks = path.during(shown, observation.sequences[[which for which, _ in some]])
            yield from zip(masks, (numbers for _, numbers in some), strict=True)


def _lit(scenes: list[torch.Tensor]) -> torch.Tensor:
    """Return which scenes are not even and dark, ``(N,)`` bool."""
    return torch.tensor([scene.shape[1:] != (1, 1) or bool(scene.any()) for scene in scenes])


def free_forms_for(observation: Observation) -> dict[str, type[Effect]]:
    """Return every free-form deviation by name, with as many numbers as these captures can determine."""
    classes = [getattr(free_form, name) for name in free_form.__all__ if name != "FreeForm"]
    if observation.grid is not None:  # a map of the mirrors is not one of the pixels
        classes = [one for one in classes if not (one.map_kind and issubclass(one, ModulatorEffect))]
    captures, frames = len(observation), observation.frames
    return {one.name: one.of(one.numbers(captures, frames)) if issubclass(one, FreeForm) else one for one in classes}


def behind(path: LightPath, effect: type[Effect]) -> LightPath:
    """Return the sensor's effects that act after one of them."""
    return LightPath(other for other in path.of(SensorEffect) if other.rank > effect.rank)


def _set_map(effect: MapEffect, values: torch.Tensor | None, size: tuple[int, int]) -> None:
    """Give an effect its map, in units of its standard deviation if it has one."""
    if values is None:
        effect.map = torch.zeros(effect.shape(size))
    elif "std" in effect.about:
        effect.map = values / max(float(effect.std), 1e-12)
    else:
        effect.map = values


def effect_key(effect: Effect) -> Hashable:
    """Return what identifies an effect with its parameters and every value of its map."""
    content = effect.map.numpy().tobytes() if isinstance(effect, MapEffect) else None
    return effect.name, tuple(effect.values.items()), content
