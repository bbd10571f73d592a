"""Maximum-likelihood fits: all parameters of a hypothesis and its fixed-pattern maps, by a damped Newton method.

The objective is the log-likelihood of the fitted pixels (:mod:`~sci_lightning.diagnosis.model.likelihood`), penalised
by the prior and the uncertainty of the maps (:mod:`~sci_lightning.diagnosis.model.fixed_pattern_map`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import torch

from sci_lightning.diagnosis.fit.budget import Budget
from sci_lightning.diagnosis.fit.derivatives import Derivatives, differentiate
from sci_lightning.diagnosis.fit.levenberg_marquardt import MIN_PROGRESS_NATS, maximise
from sci_lightning.diagnosis.fit.parameters import FreeParameters
from sci_lightning.diagnosis.fit.split import Split
from sci_lightning.diagnosis.model.camera_model import CameraModel, Evaluated
from sci_lightning.diagnosis.model.fixed_pattern_map import (
    MAX_TYPICAL_SIZES,
    FixedPatternMap,
    with_map_uncertainty,
    with_means_given_away,
)
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, ParameterName
from sci_lightning.diagnosis.model.likelihood import Intervals, PixelLikelihood, Prediction, log_likelihood
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.model.smooth_map import estimate_map
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.encoder.border import Border

COARSE_PIXELS = 60_000
"""Pixels on which fits begin and strong candidates are screened if the captures have more than four times as many;
enough that no parameter is undetermined."""
ATTEMPTS = 6
"""Steps that are tried in an iteration, each with more damping than the one before."""
MAX_PROMISED_RATIO = 20.0
"""A fit that has to reach some log-likelihood is abandoned when it lacks more than so many times what its next step, by
the quadratic approximation, would gain: near the maximum of such a fit every step gains a small part of the one before,
far from it the approximation is wrong by a small factor."""
MIN_LABORATORY_NATS = 10.0
"""Nats from which the errors of a laboratory are there beyond doubt."""
SHORTER_MAP_STEP = 0.4
"""Part of the maps' step that is tried next when a step was too long."""


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    Attributes:
        fitter: made it, and knows which pixels count.
        hypothesis: with its maximum-likelihood parameters and maps.
        prediction: of every capture.
        fitted_log_likelihood: of the fitted pixels, penalised by the maps' prior and uncertainty, nats.
        held_out_log_likelihood: of the held-out pixels, nats.
        free: names of the fitted parameters.
        information: ``(p, p)`` Fisher information about them (about logarithms, where these are fitted), the maps
            eliminated.
        maps: state of the fixed-pattern maps by effect.
        abandoned: whether it could not reach the log-likelihood that it had to.
    """

    fitter: Fitter = field(repr=False, compare=False)
    hypothesis: Hypothesis
    prediction: Prediction
    fitted_log_likelihood: float
    held_out_log_likelihood: float
    free: tuple[ParameterName, ...] = ()
    information: torch.Tensor = field(default_factory=lambda: torch.zeros(0, 0))
    maps: Mapping[str, FixedPatternMap] = field(default_factory=dict)
    abandoned: bool = False

    @property
    def log_likelihood(self) -> float:
        """Penalised log-likelihood of all pixels, fitted and held out, nats."""
        return self.fitted_log_likelihood + self.held_out_log_likelihood

    @property
    def in_laboratory(self) -> bool:
        """Whether the model has the errors of a laboratory."""
        return any(name in self.hypothesis.effects for name in self.fitter.model.imperfections)

    @property
    def beyond_laboratory(self) -> bool:
        """Whether errors of exposures or targets are as large as they may be, so that something else is missing."""
        typical = {name: getattr(self.fitter.model.effects[name], "typical", math.inf) for name in self.maps}
        return any(one.std > 0.99 * MAX_TYPICAL_SIZES * typical[name] for name, one in self.maps.items())

    @property
    def uncertain_prediction(self) -> Prediction:
        """The prediction with the maps' uncertainty in its standard deviation, for pixels that no fit has seen."""
        return with_map_uncertainty(self.prediction, self.maps)

    @property
    def evaluated(self) -> Evaluated:
        """The hypothesis with the likelihood of every pixel and its derivatives, which are computed anew."""
        return self.fitter.evaluate(self.hypothesis, self.prediction)

    @cached_property
    def derivatives(self) -> Derivatives:
        """Derivatives of the objective at the end of the fit."""
        return self.fitter.differentiate(self.evaluated, FreeParameters(self.fitter.model, self.free))

    @property
    def fixed(self) -> tuple[ParameterName, ...]:
        """Names of the parameters that the fit kept."""
        every = FreeParameters.of(self.fitter.model, self.hypothesis).names
        return tuple(name for name in every if name not in self.free)

    def without(self, name: str, iterations: int = 12, from_afar: bool = False) -> Fit:
        """Return a fit of the same parameters without an effect, from the values that they have; it is kept."""
        key = name, iterations, from_afar
        if key not in self._without:
            smaller = self.hypothesis.without(name)
            self._without[key] = self.fitter.fit(smaller, iterations, self.fixed, from_afar=from_afar)
        return self._without[key]

    @cached_property
    def _without(self) -> dict[tuple[str, int, bool], Fit]:
        return {}

    def explained_nats(self, baseline: Fit, noise: Fit | None = None) -> float:
        """Return the log-likelihood that the mean gains over that of another fit, in nats, at least 0.

        Both use the standard deviation of the fit ``noise`` (None: of this one), so that a change of noise alone does
        not count as a gain.
        """
        fitter = self.fitter
        deviation, bits = fitter.predicted(noise or self).deviation, self.prediction.bits
        after, before = (Prediction(fitter.predicted(fit).mean, deviation, bits) for fit in (self, baseline))
        gain = fitter.log_likelihood(after) - fitter.log_likelihood(before)
        return max(0.0, float(gain.sum(dtype=torch.float64)))

    def seen_coarsely(self) -> Fit:
        """Return the fit as it predicts the pixels of :attr:`Fitter.coarse`; itself where there is none."""
        coarse = self.fitter.coarse
        if coarse is None:
            return self
        return replace(self, fitter=coarse, prediction=coarse.model.predict(self.hypothesis))


class Fitter:
    """Fits hypotheses to the fitted pixels of the captures.

    Only pixels inside the split's border are predicted and compared: every ``(N, H, W)`` below is of these.

    Args:
        model: predicts the captures.
        split: which pixels are fitted and which are held out.
        settings: thresholds and budgets; None for the defaults.
        stride: every so many rows and columns are compared.
        budget: processor time for everything that is fitted; None for no limit.
    """

    def __init__(
        self,
        model: CameraModel,
        split: Split,
        settings: SearchSettings | None = None,
        stride: int = 1,
        budget: Budget | None = None,
    ) -> None:
        self.model = model.inside(split.border, stride)
        self.split = split
        self.settings = settings or SearchSettings()
        self.budget = budget or Budget(math.inf)
        self.dn = self.model.windowed(model.observation.dn)
        self.fitted = self.model.windowed(split.fitted).float()
        self.held_out = self.model.windowed(split.held_out).float()
        self._intervals: dict[int, Intervals] = {}

    @cached_property
    def coarse(self) -> Fitter | None:
        """A fitter of the same model that compares every second capture, and of these some rows and columns.

        It has at most ``COARSE_PIXELS`` pixels to fit. None where there are less than four times as many
        anyway.
        """
        surplus = float(self.fitted.sum()) / COARSE_PIXELS
        if surplus < 4:
            return None
        observation, split = self.model.observation, self.split
        some = torch.zeros(len(observation), dtype=torch.bool)
        for kind in set(observation.kinds):
            members = [
                n for n, other in enumerate(observation.kinds) if other == kind and not split.held_out_capture[n]
            ]
            some[members[::2]] = True
        nobody = torch.zeros(int(some.sum()), dtype=torch.bool)
        subset = replace(split, assigned=split.assigned[some], held_out_captures=(), held_out_capture=nobody)
        stride = math.ceil(math.sqrt(surplus / 2))
        return Fitter(self.model.of_captures(observation.take(some)), subset, self.settings, stride, self.budget)

    def of_captures(self, observation: Observation, fitted: bool) -> Fitter:
        """Return a fitter of other captures of the same camera, of which all pixels inside the same border count.

        Args:
            observation: the captures.
            fitted: whether all of them are fitted; else all are held out.
        """
        split = Split.all_alike(observation, fitted, self.split.border)
        return Fitter(self.model.of_captures(observation), split, self.settings, budget=self.budget)

    @property
    def pixels(self) -> int:
        """How many pixels count, fitted and held out."""
        return self.split.pixels

    def covering(self, *hypotheses: Hypothesis) -> Fitter:
        """Return a fitter that leaves out every pixel that depends, by any of the hypotheses, on the unknown surround.

        It leaves out what this fitter leaves out as well, and is this fitter where that suffices. At most
        ``SearchSettings.border_share`` of the field is left out on either of two opposite sides.
        """
        border = Border()
        for hypothesis in hypotheses:
            border = border | self.model.border(hypothesis)
        border = border.rounded().limited(self.model.observation.size, self.settings.border_share)
        return self if self.split.border.contains(border) else self.with_border(border)

    def covers(self, hypothesis: Hypothesis) -> bool:
        """Return whether no pixel that counts depends on the unknown surround by a hypothesis."""
        border = self.model.border(hypothesis).rounded()
        return self.split.border.contains(border.limited(self.model.observation.size, self.settings.border_share))

    def with_border(self, border: Border) -> Fitter:
        """Return a fitter that leaves out a border of whole pixels as well; this one where that changes nothing."""
        wider = self.split.border | border
        if wider == self.split.border:
            return self
        return Fitter(self.model, replace(self.split, border=wider), self.settings, budget=self.budget)

    def repeated(self, fit: Fit) -> Fit:
        """Return a fit repeated with the pixels that count here; the fit itself if it was made with these.

        Maps know nothing yet about pixels that have not counted before. They come first: the parameters would try to
        explain what the maps lack there.
        """
        if fit.fitter.split.border == self.split.border:
            return fit
        start = self._with_hot_pixels(fit.hypothesis)
        if fit.maps and self.pixels > fit.fitter.pixels:
            start = self.fit(start, iterations=8, fixed=FreeParameters.of(self.model, start).names).hypothesis
        return self.fit(start, iterations=20, fixed=fit.fixed)

    def _with_hot_pixels(self, hypothesis: Hypothesis) -> Hypothesis:
        """Return a hypothesis that names the hot pixels among those that count here.

        They come before everything else is fitted again: noise and errors of the laboratory would make room for them.
        """
        hot = [name for name in hypothesis.effects if self.model.effects[name].map_kind == "hot"]
        for one in self.maps(self.evaluate(hypothesis)) if hot else ():
            if one.name in hot:
                step = torch.where(one.active, one.gradient / one.precision, 0.0)
                hypothesis = hypothesis.with_effect(one.name, *one.moved(self.model, step))
        return hypothesis

    def fit(
        self,
        hypothesis: Hypothesis,
        iterations: int = 12,
        fixed: tuple[ParameterName, ...] = (),
        to_reach: float = -math.inf,
        from_afar: bool = False,
    ) -> Fit:
        """Run a maximum-likelihood fit by maximising the penalised log-likelihood of the fitted pixels.

        Every iteration approximates the objective by a quadratic function of parameters and map values and takes the
        step to its maximum. A step that would lower the objective is repeated with more damping of the parameters
        (Levenberg and Marquardt) and a shorter step of the maps. The fit ends when an iteration gains less than
        ``MIN_PROGRESS_NATS``. The information and the maps that it returns are those at the start of the
        last iteration, which lies within that gain of its end.

        Args:
            hypothesis: where to start.
            iterations: at most.
            fixed: parameters that keep their values.
            to_reach: log-likelihood of the fitted pixels below which the result is of no use; once it is clear that the
                fit cannot get there, it is abandoned. A hypothesis that depends on the surround, and would gain if
                fewer pixels counted, never is.
            from_afar: whether the start may be far from the maximum; :attr:`coarse` then goes most of the way.
        """
        hypothesis = with_means_given_away(self.model, hypothesis)
        if from_afar and self.coarse is not None:
            nearer = self.coarse.fit(hypothesis, iterations, fixed).hypothesis
            hypothesis = Hypothesis(nearer.effects, hypothesis.maps)
        free = FreeParameters.of(self.model, hypothesis, fixed)

        def step(at: Evaluated, derivatives: Derivatives, damping: float, attempt: int) -> tuple[Evaluated, float]:
            moved = self.evaluate(derivatives.step(damping, SHORTER_MAP_STEP**attempt))
            reached = self._sum(moved.likelihood.log_likelihood) - derivatives.penalty(moved)
            return replace(moved, objective=reached), reached - derivatives.objective

        def hopeless(at: Evaluated, derivatives: Derivatives) -> bool:
            lacking = to_reach - derivatives.objective
            promised = derivatives.promised() if lacking > 0 else 0.0
            return derivatives.objective + MAX_PROMISED_RATIO * promised < to_reach and self.covers(at.hypothesis)

        enough = MIN_PROGRESS_NATS
        start, differentiated = self.evaluate(hypothesis), partial(self.differentiate, free=free)
        end, last = maximise(start, differentiated, step, lambda _: enough, iterations, ATTEMPTS, hopeless)
        objective = last.objective if end.objective is None else end.objective
        uncertain = end.likelihood.log_likelihood
        if last.maps:
            uncertain = self.log_likelihood(with_map_uncertainty(end.prediction, last.maps))
        held_out = float((uncertain * self.held_out).sum(dtype=torch.float64))
        held_out -= sum(fixed_map.own_penalty for fixed_map in last.maps.values())
        abandoned = objective < to_reach and self.covers(end.hypothesis)
        numbers = objective, held_out, free.names, last.information, last.maps, abandoned
        return Fit(self, end.hypothesis, end.prediction, *numbers)

    def intervals(self, bits: int) -> Intervals:
        """Return the signal intervals of the captures' DN for a converter of so many effective bits."""
        if bits not in self._intervals:
            self._intervals[bits] = Intervals.of(self.dn, self.model.observation.bit_depth, bits)
        return self._intervals[bits]

    def evaluate(self, hypothesis: Hypothesis, prediction: Prediction | None = None) -> Evaluated:
        """Return a hypothesis with its prediction, which need not be computed where it is known, and likelihood."""
        prediction = prediction or self.model.predict(hypothesis)
        return Evaluated(hypothesis, prediction, PixelLikelihood(self.intervals(prediction.bits), prediction))

    def differentiate(self, at: Evaluated, free: FreeParameters) -> Derivatives:
        """Return the derivatives of the objective with respect to some parameters and to all maps."""
        maps = {fixed_map.name: fixed_map for fixed_map in self.maps(at)}
        return differentiate(at, free, maps, self.fitted, self.log_likelihood)

    def log_likelihood(self, prediction: Prediction) -> torch.Tensor:
        """Return the log-likelihood ``(N, H, W)`` of every pixel, nats."""
        return log_likelihood(self.intervals(prediction.bits), prediction)

    def _sum(self, values: torch.Tensor) -> float:
        """Sum over the fitted pixels."""
        return float((values * self.fitted).sum(dtype=torch.float64))

    def predicted(self, fit: Fit) -> Prediction:
        """Return what a fit predicts for the pixels that count here, which may be others than for its maker."""
        prediction = fit.prediction
        return prediction if prediction.window == self.model.window else self.model.predict(fit.hypothesis)

    def maps(self, at: Evaluated) -> list[FixedPatternMap]:
        """Return the state of every fixed-pattern map of a hypothesis."""
        effects = self.model.effects
        names = [name for name in at.hypothesis.effects if effects[name].map_kind]
        states: dict[str, FixedPatternMap] = {}
        # smooth maps come last: they must not take what the maps of pixels say already
        for name in sorted(names, key=lambda name: (effects[name].map_kind == "smooth", not effects[name].of_captures)):
            states[name] = estimate_map(self.model, at, name, self.fitted, tuple(states.values()))
        return [states[name] for name in names]
