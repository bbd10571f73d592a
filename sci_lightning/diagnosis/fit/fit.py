"""Maximum-likelihood fits: all parameters of a hypothesis and its fixed-pattern maps, by a damped Newton method.

The objective is the log-likelihood of the fitted pixels (:mod:`~sci_lightning.diagnosis.model.likelihood`), penalised
by the prior and the uncertainty of the maps (:mod:`~sci_lightning.diagnosis.model.fixed_pattern_map`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import torch

from sci_lightning.diagnosis.fit.newton_system import Damping, NewtonSystem
from sci_lightning.diagnosis.fit.parameters import FINE_DIFFERENCE, FreeParameters
from sci_lightning.diagnosis.fit.split import Split
from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis, ParameterName
from sci_lightning.diagnosis.model.fixed_pattern_map import FixedPatternMap, estimate_map, with_means_given_away
from sci_lightning.diagnosis.model.likelihood import (
    ClippedSignal,
    Intervals,
    PixelLikelihood,
    log_likelihood,
)
from sci_lightning.diagnosis.model.map_system import MapSystem
from sci_lightning.diagnosis.model.prediction import Prediction
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.encoder.border import Border

HOPE = 20.0
"""A fit that has to reach some log-likelihood is given up when it lacks more than so many times what its next step, by
the quadratic approximation, would gain: near the maximum of such a fit every step gains a small part of the one before,
far from it the approximation is wrong by a small factor."""
SHORTER = 0.4
"""Part of the maps' step that is tried next when a step was too long."""


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    Attributes:
        hypothesis: with its maximum-likelihood parameters and maps.
        prediction: of every capture.
        fitted_log_likelihood: of the fitted pixels, penalised by the maps' prior and uncertainty, nats.
        held_out_log_likelihood: of the held-out pixels, nats.
        free: names of the fitted parameters.
        information: ``(p, p)`` Fisher information about them (about logarithms, where these are fitted), the maps
            eliminated.
        maps: state of the fixed-pattern maps by effect.
        given_up: whether it could not reach the log-likelihood asked for.
    """

    hypothesis: Hypothesis
    prediction: Prediction
    fitted_log_likelihood: float
    held_out_log_likelihood: float
    free: tuple[ParameterName, ...] = ()
    information: torch.Tensor = field(default_factory=lambda: torch.zeros(0, 0))
    maps: Mapping[str, FixedPatternMap] = field(default_factory=dict)
    given_up: bool = False

    @property
    def log_likelihood(self) -> float:
        """Penalised log-likelihood of all pixels, fitted and held out, nats."""
        return self.fitted_log_likelihood + self.held_out_log_likelihood


class Fitter:
    """Fits hypotheses to the fitted pixels of the captures.

    Only pixels inside the split's border are predicted and compared: every ``(N, H, W)`` below is of these.

    Args:
        model: predicts the captures.
        split: which pixels are fitted and which are held out.
        settings: thresholds and budgets; None for the defaults.
        stride: every so many rows and columns are compared.
    """

    def __init__(
        self, model: CameraModel, split: Split, settings: SearchSettings | None = None, stride: int = 1
    ) -> None:
        self.model = model.inside(split.border, stride)
        self.split = split
        self.settings = settings or SearchSettings()
        self.dn = self.model.windowed(model.observation.dn)
        self.fitted = self.model.windowed(split.fitted).float()
        self.held_out = self.model.windowed(split.held_out).float()
        self._intervals: dict[int, Intervals] = {}

    @cached_property
    def coarse(self) -> Fitter | None:
        """A fitter of the same model that compares every second capture, and of these some rows and columns.

        It has at most ``SearchSettings.coarse_pixels`` pixels to fit. None where there are less than four times as many
        anyway.
        """
        surplus = float(self.fitted.sum()) / self.settings.coarse_pixels
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
        return Fitter(self.model.of_captures(observation.take(some)), subset, self.settings, stride)

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
        return self.leaving_out(border)

    def covers(self, hypothesis: Hypothesis) -> bool:
        """Return whether no pixel that counts depends on the unknown surround by a hypothesis."""
        border = self.model.border(hypothesis).rounded()
        return self.split.border.contains(border.limited(self.model.observation.size, self.settings.border_share))

    def leaving_out(self, border: Border) -> Fitter:
        """Return a fitter that leaves out a border of any width as well; see :meth:`covering`."""
        border = border.rounded().limited(self.model.observation.size, self.settings.border_share)
        return self if self.split.border.contains(border) else self.with_border(self.split.border | border)

    def with_border(self, border: Border) -> Fitter:
        """Return a fitter for which other pixels count: those inside a border of whole pixels."""
        if border == self.split.border:
            return self
        return Fitter(self.model, replace(self.split, border=border), self.settings)

    def again(self, fit: Fit) -> Fit:
        """Return a fit of another fitter, which counted other pixels, repeated with this one's."""
        every = FreeParameters.of(self.model, fit.hypothesis).names
        fixed = tuple(name for name in every if name not in fit.free)
        return self.fit(fit.hypothesis, iterations=20, fixed=fixed)

    def fit(
        self,
        hypothesis: Hypothesis,
        iterations: int = 12,
        fixed: tuple[ParameterName, ...] = (),
        fit_maps: bool = True,
        to_reach: float = -math.inf,
        from_afar: bool = False,
    ) -> Fit:
        """Run a maximum-likelihood fit by maximising the penalised log-likelihood of the fitted pixels.

        Every iteration approximates the objective by a quadratic function of parameters and map values and takes the
        step to its maximum. A step that would lower the objective is repeated with more damping of the parameters
        (Levenberg and Marquardt) and a shorter step of the maps. The fit ends when an iteration gains less than
        ``SearchSettings.min_progress_nats``. The information and the maps that it returns are those at the start of the
        last iteration, which lies within that gain of its end.

        Args:
            hypothesis: where to start.
            iterations: at most.
            fixed: parameters that keep their values.
            fit_maps: whether fixed-pattern maps are fitted too.
            to_reach: log-likelihood of the fitted pixels below which the result is of no use; once it is clear that the
                fit cannot get there, it is given up. A hypothesis that depends on the surround, and would gain if fewer
                pixels counted, never is.
            from_afar: whether the start may be far from the maximum; :attr:`coarse` then goes most of the way.
        """
        hypothesis = with_means_given_away(self.model, hypothesis)
        if from_afar and self.coarse is not None:
            nearer = self.coarse.fit(hypothesis, iterations, fixed, fit_maps).hypothesis
            hypothesis = Hypothesis(nearer.effects, hypothesis.maps)
        free = FreeParameters.of(self.model, hypothesis, fixed)
        prediction = self.model.predict(hypothesis)
        objective, damping = -math.inf, Damping(most=6)
        maps: dict[str, FixedPatternMap] = {}
        information = torch.zeros(len(free), len(free))
        likelihood = self.pixel_likelihood(prediction)
        for _ in range(iterations):
            if fit_maps:
                maps = {fixed_map.name: fixed_map for fixed_map in self.maps(hypothesis, prediction, likelihood)}
            newton = self._newton_system(hypothesis, free, prediction, likelihood, maps)
            information = newton.information
            if not math.isfinite(objective):  # afterwards the accepted step says it, with the priors of its iteration
                objective = self._sum(likelihood.log_likelihood) - sum(fixed_map.penalty for fixed_map in maps.values())
            before = objective
            if objective < to_reach:
                promised = newton.gain(free.movable(hypothesis, newton.gradient))
                if objective + HOPE * promised < to_reach and self.covers(hypothesis):
                    break
            for attempt in damping.attempts():
                moved = self._step(hypothesis, free, newton, damping.value, SHORTER**attempt)
                trial = self.model.predict(moved)
                judged = self.pixel_likelihood(trial)
                reached = self._sum(judged.log_likelihood) - self._penalty(moved, trial, maps, likelihood, prediction)
                if reached >= objective:
                    hypothesis, prediction, likelihood, objective = moved, trial, judged, reached
                    damping.accepted = True
            if objective - before < self.settings.min_progress_nats:
                break
        uncertain = likelihood.log_likelihood
        if maps:
            uncertain = self.log_likelihood(self.with_map_uncertainty(prediction, maps))
        held_out = float((uncertain * self.held_out).sum(dtype=torch.float64))
        given_up = objective < to_reach and self.covers(hypothesis)
        return Fit(hypothesis, prediction, objective, held_out, free.names, information, maps, given_up)

    def _step(
        self, hypothesis: Hypothesis, free: FreeParameters, newton: NewtonSystem, damping: float, part: float
    ) -> Hypothesis:
        """Take a Newton step of the free parameters, damped, and the given part of the step of the maps."""
        moved, step = free.newton_step(hypothesis, newton.gradient, newton.information, damping)
        map_steps = newton.maps.split((newton.map_step - step @ newton.map_response) * part)
        for fixed_map, map_step in zip(newton.maps.maps, map_steps, strict=True):
            setting, values = fixed_map.moved(self.model, map_step[0])
            moved = moved.with_effect(fixed_map.name, setting, values)
        return moved

    def _penalty(
        self,
        hypothesis: Hypothesis,
        prediction: Prediction,
        maps: Mapping[str, FixedPatternMap],
        likelihood: PixelLikelihood,
        start: Prediction,
    ) -> float:
        """Return what the maps take off the log-likelihood of the fitted pixels after a step, in nats.

        Args:
            hypothesis: after the step.
            prediction: of it.
            maps: before the step; the width of their prior is kept fixed within an iteration.
            likelihood: before the step; its Fisher information is rescaled by the change of every pixel's variance.
            start: the prediction before the step.
        """
        penalty = 0.0
        if maps:
            scale = likelihood.mean_information * self.fitted * start.total_variance / prediction.total_variance
            for name, fixed_map in maps.items():
                squared = self.model.map_jacobian(hypothesis, name, prediction).square()
                penalty += fixed_map.penalty_of(self.model, hypothesis.maps[name], (squared * scale).sum(0))
        return penalty

    def _newton_system(
        self,
        hypothesis: Hypothesis,
        free: FreeParameters,
        prediction: Prediction,
        likelihood: PixelLikelihood,
        maps: Mapping[str, FixedPatternMap],
    ) -> NewtonSystem:
        """Approximate the objective by a quadratic function of the free parameters, the maps eliminated.

        With m the mean and s the logarithm of the standard deviation of a pixel, the information about the parameters
        is the sum over the pixels of I_m dm dm^T + I_s ds ds^T. The map values enter through the Schur complement.
        """
        weight = likelihood.mean_information * self.fitted
        system = MapSystem(list(maps.values()), weight)
        mean, spread, map_cost = self._derivatives(hypothesis, free, prediction, system.maps, weight)
        weighted_mean, weighted_spread = mean * weight, spread * (likelihood.spread_information * self.fitted)
        per_pixel = (mean * likelihood.mean_gradient + spread * likelihood.spread_gradient) * self.fitted
        gradient = per_pixel.flatten(1).sum(1, dtype=torch.float64)
        information = (
            weighted_mean.flatten(1) @ mean.flatten(1).T + weighted_spread.flatten(1) @ spread.flatten(1).T
        ).double()
        if prediction.clipped is not None and len(free):  # mean and deviation do not describe a clipped signal
            gradient, spike = self._clipped_derivatives(hypothesis, free, prediction.clipped, likelihood)
            information += spike
        # Fitting a fixed-pattern map absorbs part of the noise, so the residuals understate it. Add the absorbed
        # variance (the map's leverage) back before updating the noise level.
        leverage = sum(fixed_map.leverage for fixed_map in system.maps)
        gradient += (spread * (weight * leverage)).flatten(1).sum(1, dtype=torch.float64) - map_cost
        cross = system.cross_information(weighted_mean)
        response = system.solve(cross)
        map_step = system.solve(system.gradient[None])
        gradient, information = gradient - response @ system.gradient, information - response @ cross.T
        return NewtonSystem(gradient, information, system, map_step, response)

    def _derivatives(
        self,
        hypothesis: Hypothesis,
        free: FreeParameters,
        prediction: Prediction,
        maps: list[FixedPatternMap],
        weight: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the derivatives of the prediction and of the maps' penalty with respect to the free parameters.

        Returns:
            ``(p, N, H, W)`` of the mean, ``(p, N, H, W)`` of the logarithm of the standard deviation, and ``(p,)`` of
            the penalty for the maps' uncertainty, in nats. Without the last, a gain would be estimated too large beside
            a map that scales with it.
        """
        mean, spread = torch.empty(2, len(free), *prediction.mean.shape)
        penalty = torch.zeros(len(free), dtype=torch.float64)
        for i, (step, neighbour, shifted) in enumerate(free.neighbours(hypothesis)):
            mean[i] = (shifted.mean - prediction.mean) / step
            spread[i] = (shifted.deviation / prediction.deviation).log() / step
            for fixed_map in maps:
                if fixed_map.kind != "hot":
                    change = (self.model.map_jacobian(neighbour, fixed_map.name, shifted) - fixed_map.jacobian) / step
                    penalty[i] += fixed_map.penalty_slope(change * weight)
        return mean, spread, penalty

    def _clipped_derivatives(
        self, hypothesis: Hypothesis, free: FreeParameters, clipped: ClippedSignal, likelihood: PixelLikelihood
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Differentiate the log-likelihood itself where the signal saturates.

        Returns:
            the gradient ``(p,)``, and the information ``(p, p)`` that the spike at the saturation level adds.
        """
        slopes, level_slopes = [], []
        # central differences, because the log-likelihood is strongly curved over one step
        up_and_down = (free.neighbours(hypothesis, part) for part in (FINE_DIFFERENCE, -FINE_DIFFERENCE))
        for (step, _, above), (back, _, below) in zip(*up_and_down, strict=True):
            one_sided = step == back
            start = likelihood.log_likelihood if one_sided else self.log_likelihood(below)
            gain = (self.log_likelihood(above) - start) * self.fitted
            slopes.append(gain.sum(dtype=torch.float64) / (step if one_sided else step - back))
            level = clipped.level if above.clipped is None else above.clipped.level
            level_slopes.append(((level - clipped.level) / step).expand_as(clipped.mean).flatten())
        weight = clipped.mixed * (1 - clipped.kept) / (clipped.read.square() + 1 / 12) * self.fitted
        levels = torch.stack(level_slopes)
        return torch.stack(slopes), ((levels * weight.flatten()) @ levels.T).double()

    def intervals(self, bits: int) -> Intervals:
        """Return the signal intervals of the captures' DN for a converter of so many effective bits."""
        if bits not in self._intervals:
            self._intervals[bits] = Intervals.of(self.dn, self.model.observation.bit_depth, bits)
        return self._intervals[bits]

    def pixel_likelihood(self, prediction: Prediction) -> PixelLikelihood:
        """Return the log-likelihood of every pixel with its derivatives."""
        intervals = self.intervals(prediction.bits)
        return PixelLikelihood(intervals, prediction.mean, prediction.deviation, prediction.clipped)

    def log_likelihood(self, prediction: Prediction) -> torch.Tensor:
        """Return the log-likelihood ``(N, H, W)`` of every pixel, nats."""
        intervals = self.intervals(prediction.bits)
        return log_likelihood(intervals, prediction.mean, prediction.deviation, prediction.clipped)

    def _sum(self, values: torch.Tensor) -> float:
        """Sum over the fitted pixels."""
        return float((values * self.fitted).sum(dtype=torch.float64))

    def explained_nats(self, fit: Fit, baseline: Fit, noise: Fit) -> float:
        """Return the log-likelihood that the mean of one fit gains over the mean of another, in nats, at least 0.

        Both use the standard deviation of the fit ``noise``, so that a change of noise alone does not count as a gain.
        """
        deviation, bits = self.predicted(noise).deviation, fit.prediction.bits
        after, before = (Prediction(self.predicted(judged).mean, deviation, bits) for judged in (fit, baseline))
        gain = self.log_likelihood(after) - self.log_likelihood(before)
        return max(0.0, float(gain.sum(dtype=torch.float64)))

    def predicted(self, fit: Fit) -> Prediction:
        """Return what a fit predicts for the pixels that count here, which may be others than for its maker."""
        prediction = fit.prediction
        return prediction if prediction.window == self.model.window else self.model.predict(fit.hypothesis)

    def seen_coarsely(self, fit: Fit) -> tuple[Fitter, Fit]:
        """Return :attr:`coarse`, and a fit as it predicts the pixels that count there; both as they are without one."""
        if self.coarse is None:
            return self, fit
        return self.coarse, replace(fit, prediction=self.coarse.model.predict(fit.hypothesis))

    def maps(
        self, hypothesis: Hypothesis, prediction: Prediction, likelihood: PixelLikelihood
    ) -> list[FixedPatternMap]:
        """Return the state of every fixed-pattern map of a hypothesis."""
        names = [name for name in hypothesis.effects if self.model.effects[name].map_kind]
        states: dict[str, FixedPatternMap] = {}
        for name in sorted(names, key=lambda name: self.model.effects[name].map_kind == "smooth"):
            beside = tuple(states.values())
            states[name] = estimate_map(self.model, hypothesis, name, prediction, likelihood, self.fitted, beside)
        return [states[name] for name in names]

    def with_map_uncertainty(self, prediction: Prediction, maps: Mapping[str, FixedPatternMap]) -> Prediction:
        """Return the prediction with the maps' uncertainty in its standard deviation, to judge held-out pixels."""
        variance = prediction.deviation.square()
        for fixed_map in maps.values():
            variance = variance + fixed_map.leverage
        return replace(prediction, deviation=variance.sqrt()) if maps else prediction
