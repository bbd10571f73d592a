"""A search for missing effects by the prediction of held-out pixels alone: it needs no statistics of scenes.

Effects are added one by one as long as they make held-out pixels more predictable. Every candidate is fitted on a
textured window of the snapshots; a decision is made on whole snapshots, and judged on those set aside.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import torch

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.diagnosis.blind.paired_comparison import PairedComparison, compare
from sci_lightning.diagnosis.blind.prediction import HeldOutErrors, Predictor, textured_window
from sci_lightning.diagnosis.blind.prediction_verdict import MASK_HELPS, WITHOUT_MASK
from sci_lightning.diagnosis.blind.snapshot_camera import SnapshotCamera
from sci_lightning.diagnosis.laboratory import SceneEffect
from sci_lightning.diagnosis.model.camera_model import Setting
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import Effect, MapEffect, OpticsEffect, Parameter, SensorEffect

LEAST_PROGRESS = 2e-4
"""Part of the prediction error by which a step must lower it for another step of the same length."""

Effects = Mapping[str, Setting]
"""Values of the parameters by name, by effect."""

LONGEST_VIDEO = 16
"""Slots over which the statistics of video reach; snapshots of more are diagnosed by prediction alone."""
UNSEEN = ("gain", "vignetting", "saturation", "duty_cycle", "flicker", "illumination", "pattern_order")
"""Effects that a reconstruction absorbs: the scene, or a frame of it, may be brighter or darker instead, or its frames
may come in another order."""
OF_THE_FIELD = (
    "mask_rotation",
    "mask_scale",
    "mask_keystone",
    "mask_distortion",
    "mask_orientation",
    "rolling_shutter",
)
"""Effects that depend on the place in the field, and are not looked for where only a part of it is reconstructed."""
MARGIN = 16
"""Pixels around a window that its masks are computed with."""
SAME_AS = {"mask_blur": ("optical_blur",), "black_level": ("veiling_glare",)}
"""Effects that held-out pixels do not tell from one that was named, without detail of the mask's size in the scene."""


@dataclass(frozen=True)
class PredictionSettings:
    """Thresholds and budgets of the search.

    Attributes:
        window: side in pixels of the textured window on which candidates are fitted.
        judged: side in pixels of the largest field that is fitted and judged as a whole; of a larger one the window
            of this side with the most texture is judged, and effects that depend on the place in the field are not
            looked for.
        window_folds: folds of held-out pixels while candidates are fitted.
        folds: folds of held-out pixels for a decision.
        most: largest number of effects.
        polished: candidates per round whose parameters are fitted; of the others only a few settings are tried.
        max_p_value: largest corrected p-value with which an effect is added.
        min_fall: smallest part of the prediction error that an effect must remove: noise, which no camera predicts,
            bounds it from above, and a smaller gain has no practical relevance.
        finest: smallest step of a parameter, as a part of its first one.
        border: pixels along the sides that never judge where the surround is unknown.
    """

    window: int = 128
    judged: int = 256
    window_folds: int = 2
    folds: int = 4
    most: int = 3
    polished: int = 4
    max_p_value: float = 1e-3
    min_fall: float = 0.01
    finest: float = 0.1
    border: int = 4


@dataclass(frozen=True)
class PredictedEffect:
    """An effect that makes held-out pixels more predictable.

    Attributes:
        name: of the effect.
        values: of its parameters.
        deviation: standard deviation of every number, from the scatter between parts of the snapshots; NaN where
            they do not determine it.
        evidence: the camera without the effect against the camera with it.
        alternatives: effects that these snapshots do not tell from it.
    """

    name: str
    values: Setting
    deviation: dict[str, float]
    evidence: PairedComparison
    alternatives: tuple[str, ...] = ()


@dataclass(frozen=True)
class PredictionResult:
    """The result of a search by prediction.

    Attributes:
        effects: what was named, in the order in which it was found.
        fitted: the ideal camera against the one that was found, on the snapshots that the search has seen.
        verification: the same on snapshots that were set aside; None where there are none.
        all_snapshots: the same on both.
        considered: prediction error of every candidate's best setting in every round, by effect.
        seed: of the held-out pixels.
        without_mask: a camera whose mask is the same everywhere against the one that was found. Where the second is not
            better, the snapshots do not show that what was found is right: they are as predictable without any mask.
    """

    effects: tuple[PredictedEffect, ...]
    fitted: PairedComparison
    verification: PairedComparison | None
    all_snapshots: PairedComparison
    considered: tuple[dict[str, float], ...]
    seed: int
    without_mask: PairedComparison

    @property
    def mask_is_visible(self) -> bool:
        """Whether the mask helps to predict held-out pixels at all."""
        return self.without_mask.fall > 0 and self.without_mask.p_value < MASK_HELPS

    @property
    def verdict(self) -> str:
        """``consistent`` or ``explained``; ``unexplained`` where verification does not confirm what was named.

        It is ``unexplained`` as well where the mask does not help: then whatever weakens it predicts better.
        """
        if not self.mask_is_visible:
            return "unexplained"
        if not self.effects:
            return "consistent"
        return "explained" if (self.verification or self.fitted).fall > 0 else "unexplained"

    @property
    def values(self) -> dict[str, Setting]:
        """Values of the parameters by name, by effect."""
        return {effect.name: effect.values for effect in self.effects}


@dataclass
class _Fitter:
    """Fits parameters on a window of the snapshots; remembers what it has computed."""

    camera: SnapshotCamera
    predictor: Predictor
    finest: float
    known: dict[str, HeldOutErrors] = field(default_factory=dict)

    def errors(self, effects: Effects) -> HeldOutErrors:
        key = repr(sorted((name, sorted(setting.items())) for name, setting in effects.items()))
        if key not in self.known:
            self.known[key] = self.predictor.errors(self.camera.encoder(effects))
        return self.known[key]

    def error(self, effects: Effects) -> float:
        return self.errors(effects).prediction_error

    def best_start(self, base: Effects, name: str) -> dict[str, Setting]:
        """Return ``base`` with one more effect at the best of its starts."""
        effect = self.camera.vocabulary[name]
        starts = effect.starts(len(self.camera.patterns), self.camera.size, self.camera.bit_depth)
        if effect.is_discrete():
            return min(({**base, name: start} for start in starts), key=self.error)
        best = {**base, name: _neutral(effect)}
        for parameter, facts in effect.about.items():  # axis by axis: the product of all starts is too large
            best = min([best, *(_changed(best, name, parameter, value) for value in facts.starts)], key=self.error)
        return best

    def polished(self, effects: Effects, names: tuple[str, ...]) -> dict[str, Setting]:
        """Return the effects with the numbers of ``names`` moved to a minimum, axis by axis with shrinking steps."""
        best = dict(effects)
        axes = [
            (name, parameter, facts)
            for name in names
            for parameter, facts in self.camera.vocabulary[name].about.items()
            if not facts.choices
        ]
        part = 1.0
        while part >= self.finest:
            moved = False
            for name, parameter, facts in axes:
                step = part * _first_step(facts)
                here = float(best[name][parameter])
                trials = [best]
                for value in (here - step, here + step):
                    value = min(max(value, facts.low), facts.high)
                    trials.append(_changed(best, name, parameter, value))
                winner = min(trials, key=self.error)
                moved |= self.error(winner) < (1 - LEAST_PROGRESS) * self.error(best)
                best = winner
            part = part if moved else part / 2
        return best


def search_by_prediction(
    camera: SnapshotCamera,
    decoder: Decoder | None = None,
    seed: int = 0,
    settings: PredictionSettings | None = None,
    on_progress: Callable[[str], None] = lambda message: None,
) -> PredictionResult:
    """Find the effects that make held-out pixels more predictable than the camera as it is given.

    Args:
        camera: the snapshots with their patterns.
        decoder: see :class:`~sci_lightning.diagnosis.blind.prediction.Predictor`.
        seed: of the held-out pixels.
        settings: thresholds and budgets; None for the defaults.
        on_progress: called with a one-line message after every step.
    """
    settings = settings or PredictionSettings()
    seen = camera.take(~camera.verification) if (~camera.verification).any() else camera
    border = Border() if camera.dark_surround else Border.around(settings.border)
    names = [name for name, effect in camera.vocabulary.items() if acts_on_prediction(effect)]
    if max(camera.size) > settings.judged:
        part = textured_window(seen.measurement, settings.judged, settings.border)
        camera, seen = camera.window(*part), seen.window(*part)
        names = [name for name in names if name not in OF_THE_FIELD]
    whole = Predictor(camera.measurement, decoder, folds=settings.folds, seed=seed + 1, border=border)
    window = textured_window(seen.measurement, settings.window, settings.border)
    near = seen.window(*(slice(max(0, one.start - MARGIN), one.stop + MARGIN) for one in window))
    if settings.window + 2 * MARGIN < min(seen.size) and not set(names) & set(OF_THE_FIELD):
        inner = (slice(min(one.start, MARGIN), min(one.start, MARGIN) + settings.window) for one in window)
        seen, window = near, (next(inner), next(inner))
    predictor = Predictor(
        seen.measurement, decoder, folds=settings.window_folds, seed=seed, border=border, window=window
    )
    fitter = _Fitter(seen, predictor, settings.finest)
    current: dict[str, Setting] = {}
    considered: list[dict[str, float]] = []
    for number in range(1, settings.most + 1):
        fits = {name: fitter.best_start(current, name) for name in names if name not in current}
        for name in sorted(fits, key=lambda name: fitter.error(fits[name]))[: settings.polished]:
            fits[name] = fitter.polished(fits[name], (name,))
        gained = {name: fitter.error(fit) for name, fit in fits.items()}
        considered.append(gained)
        best = min(gained, key=gained.__getitem__)
        evidence = compare(fitter.errors(current), fitter.errors(fits[best]), candidates=len(fits))
        on_progress(f"round {number}: {best}, prediction error {evidence.before:.4f} to {evidence.after:.4f}")
        if evidence.p_value > settings.max_p_value or evidence.fall < settings.min_fall:
            break
        current = fitter.polished(fits[best], tuple(fits[best]))
        for name in [name for name in current if name != best]:
            if not _is_needed(fitter, current, name, settings):
                current = fitter.polished(_without(current, name), tuple(_without(current, name)))
    before, after = (whole.errors(camera.encoder(effects)) for effects in ({}, current))
    sets = {
        flag: [n for n, aside in enumerate(camera.verification.tolist()) if aside == flag] for flag in (False, True)
    }
    judged = {flag: compare(before.take(members), after.take(members)) for flag, members in sets.items() if members}
    effects = tuple(_described(fitter, current, name, considered, settings) for name in current)
    return PredictionResult(
        effects=effects,
        fitted=judged.get(False, next(iter(judged.values()))),
        verification=judged.get(True),
        all_snapshots=compare(before, after),
        considered=tuple(considered),
        seed=seed,
        without_mask=compare(whole.errors(camera.encoder_of(WITHOUT_MASK)), after),
    )


def acts_on_prediction(effect: type[Effect]) -> bool:
    """Return whether an effect changes what is predicted, and has numbers or choices rather than a map."""
    if effect.noise or effect.name in UNSEEN or issubclass(effect, (MapEffect, SceneEffect)):
        return False
    if issubclass(effect, (OpticsEffect, SensorEffect)):
        return effect.undo not in (OpticsEffect.undo, SensorEffect.undo)
    return True


def _described(
    fitter: _Fitter,
    effects: Effects,
    name: str,
    considered: list[dict[str, float]],
    settings: PredictionSettings,
) -> PredictedEffect:
    """Return one of the effects with its uncertainty, its evidence, and what may be meant instead."""
    evidence = compare(fitter.errors(_without(effects, name)), fitter.errors(effects))
    rivals = []
    if len(effects) == 1 and considered:
        error = fitter.error(effects)
        rivals = [
            other
            for other, reached in considered[0].items()
            if other != name and reached - error < settings.min_fall * error
        ]
    alternatives = tuple(dict.fromkeys((*SAME_AS.get(name, ()), *rivals)))
    deviation = {
        parameter: _deviation(fitter, effects, name, parameter, facts)
        for parameter, facts in fitter.camera.vocabulary[name].about.items()
        if not facts.choices
    }
    return PredictedEffect(name, dict(effects[name]), deviation, evidence, alternatives)


def _deviation(fitter: _Fitter, effects: Effects, name: str, parameter: str, facts: Parameter) -> float:
    """Return the standard error of a number: parts of the snapshots each have a minimum of their own.

    Every snapshot is divided into quadrants. Through the squared error of a part at three values of the parameter goes
    a parabola, whose minimum is what this part asks for; the scatter of these minima gives the error of their mean.
    """
    here, step = float(effects[name][parameter]), _first_step(facts) / 2
    low, high = max(here - step, facts.low), min(here + step, facts.high)
    if high - low < 1.5 * step:
        return math.nan
    values = torch.tensor([low, 0.5 * (low + high), high], dtype=torch.float64)
    sums = torch.stack(
        [_by_quadrant(fitter.errors(_changed(effects, name, parameter, float(value)))) for value in values]
    )
    curvature = sums[0] - 2 * sums[1] + sums[2]
    usable = curvature > 0
    if int(usable.sum()) < 3:
        return math.nan
    minima = 0.5 * (sums[0] - sums[2])[usable] / curvature[usable] * (values[1] - values[0])
    spread = minima.clamp(-4 * step, 4 * step)  # a part of little texture has its minimum anywhere
    return float(spread.std() / math.sqrt(len(spread)))


def _by_quadrant(errors: HeldOutErrors) -> torch.Tensor:
    """Return the sum of squared errors of every quadrant of every snapshot, ``(4 N,)``, over its variance."""
    squared = errors.squared.nan_to_num(0).double() / errors.variance.double()[:, None, None]
    halves = [part for rows in squared.chunk(2, 1) for part in rows.chunk(2, 2)]
    return torch.cat([half.sum((1, 2)) for half in halves])


def _is_needed(fitter: _Fitter, effects: Effects, name: str, settings: PredictionSettings) -> bool:
    """Return whether an effect still makes pixels more predictable beside those that came after it."""
    others = _without(effects, name)
    evidence = compare(fitter.errors(fitter.polished(others, tuple(others))), fitter.errors(effects))
    return evidence.p_value <= settings.max_p_value and evidence.fall >= settings.min_fall


def _neutral(effect: type[Effect]) -> Setting:
    return {
        parameter: facts.starts[0] if facts.neutral is None else facts.neutral
        for parameter, facts in effect.about.items()
    }


def _changed(effects: Effects, name: str, parameter: str, value: float | int | str) -> dict[str, Setting]:
    return {**effects, name: {**effects[name], parameter: value}}


def _without(effects: Effects, name: str) -> dict[str, Setting]:
    return {other: setting for other, setting in effects.items() if other != name}


def _first_step(facts: Parameter) -> float:
    """Return the first step of a fit: half the distance from the neutral value to the nearest start."""
    neutral = float(facts.neutral) if isinstance(facts.neutral, (int, float)) else 0.0
    distances = [abs(start - neutral) for start in facts.starts if start != neutral]
    return 0.5 * min(distances, default=10 * facts.step)
