"""The quadratic approximation of a fit's objective: derivatives at a hypothesis, and the Newton step to the maximum.

With m the mean and s the logarithm of the standard deviation of a pixel, the information about the parameters is the
sum over the pixels of I_m dm dm^T + I_s ds ds^T. The map values enter through the Schur complement.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.fit.parameters import FINE_DIFFERENCE_STEPS, FreeParameters
from sci_lightning.diagnosis.model.camera_model import Evaluated
from sci_lightning.diagnosis.model.fixed_pattern_map import FixedPatternMap
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.likelihood import ClippedSignal, Prediction
from sci_lightning.diagnosis.model.map_system import MapSystem

LogLikelihood = Callable[[Prediction], torch.Tensor]
"""From a prediction to the log-likelihood ``(N, H, W)`` of every pixel, nats."""


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of the objective at a hypothesis, the maps eliminated from them.

    Attributes:
        at: the hypothesis.
        objective: there, nats.
        free: the p parameters that may move.
        maps: the fixed-pattern maps by effect; the width of their prior is kept until the next derivatives.
        fitted: ``(N, H, W)``, 1 for fitted pixels and 0 for held-out ones.
        gradient: ``(p,)`` with respect to the free parameters.
        information: ``(p, p)`` about them.
        map_step: ``(1, S)`` Newton step of the map values if no parameter moves.
        map_response: ``(p, S)`` derivative of the best map step with respect to every parameter, sign reversed: after a
            step d of the parameters the maps move by ``map_step - d @ map_response``.
        system: of all maps.
        scores: ``(p, N, H, W)`` what every fitted pixel adds to the gradient, before maps are eliminated.
    """

    at: Evaluated
    objective: float
    free: FreeParameters
    maps: Mapping[str, FixedPatternMap]
    fitted: torch.Tensor
    gradient: torch.Tensor
    information: torch.Tensor
    map_step: torch.Tensor
    map_response: torch.Tensor
    system: MapSystem
    scores: torch.Tensor

    def own_scores(self) -> torch.Tensor:
        """Return what every fitted pixel adds to the gradient, ``(p, N, H, W)``, the maps following the parameters."""
        scores = self.scores.clone()
        by_map = self.at.likelihood.mean_gradient * self.fitted
        for fixed_map, response in zip(self.system.maps, self.system.split(self.map_response), strict=True):
            for score, values in zip(scores, response, strict=True):
                score -= fixed_map.spread(values) * fixed_map.jacobian * by_map
        return scores

    def promised(self) -> float:
        """Return the nats that the step to the maximum gains with the parameters that no bound holds."""
        movable = self.free.movable(self.at.hypothesis, self.gradient)
        gradient, information = self.gradient[movable], self.information[movable][:, movable]
        step = torch.linalg.lstsq(information, gradient[:, None], driver="gelsd").solution[:, 0]
        of_maps = float(self.map_step[0] @ self.system.gradient)
        return 0.5 * (of_maps + float(gradient @ step))

    def step(self, damping: float, part: float) -> Hypothesis:
        """Take a Newton step of the free parameters, damped, and a part of the step of the maps."""
        moved, step = self.free.newton_step(self.at.hypothesis, self.gradient, self.information, damping)
        map_steps = self.system.split((self.map_step - step @ self.map_response) * part)
        for fixed_map, map_step in zip(self.system.maps, map_steps, strict=True):
            setting, values = fixed_map.moved(self.free.model, map_step[0])
            moved = moved.with_effect(fixed_map.name, setting, values)
        return moved

    def penalty(self, moved: Evaluated) -> float:
        """Return what the maps take off the log-likelihood of the fitted pixels after a step, in nats.

        The Fisher information before the step is rescaled by the change of every pixel's variance.
        """
        if not self.maps:
            return 0.0
        before, after = self.at.prediction.total_variance, moved.prediction.total_variance
        information = self.at.likelihood.mean_information * self.fitted * before / after
        return sum(one.penalty_after(self.free.model, moved, information) for one in self.maps.values())


def differentiate(
    at: Evaluated,
    free: FreeParameters,
    maps: Mapping[str, FixedPatternMap],
    fitted: torch.Tensor,
    log_likelihood: LogLikelihood,
) -> Derivatives:
    """Differentiate the objective at a hypothesis.

    Args:
        at: the hypothesis.
        free: the parameters that may move.
        maps: its fixed-pattern maps.
        fitted: ``(N, H, W)``, 1 for fitted pixels and 0 for held-out ones.
        log_likelihood: of the captures.
    """
    objective, likelihood = at.objective, at.likelihood
    if objective is None:  # afterwards the accepted step says it, with the priors of its iteration
        fitted_nats = float((likelihood.log_likelihood * fitted).sum(dtype=torch.float64))
        objective = fitted_nats - sum(fixed_map.penalty for fixed_map in maps.values())
    weight = likelihood.mean_information * fitted
    system = MapSystem(list(maps.values()), weight)
    mean, spread, map_cost = _of_the_prediction(at, free, system.maps, weight)
    weighted_mean, weighted_spread = mean * weight, spread * (likelihood.spread_information * fitted)
    scores = (mean * likelihood.mean_gradient + spread * likelihood.spread_gradient) * fitted
    information = (
        weighted_mean.flatten(1) @ mean.flatten(1).T + weighted_spread.flatten(1) @ spread.flatten(1).T
    ).double()
    if at.prediction.clipped is not None and len(free):  # mean and deviation do not describe a clipped signal
        scores, spike = _of_a_clipped_signal(at, at.prediction.clipped, free, fitted, log_likelihood)
        information += spike
    gradient = scores.flatten(1).sum(1, dtype=torch.float64)
    # Fitting a fixed-pattern map absorbs part of the noise, so the residuals understate it. Add the absorbed
    # variance (the map's leverage) back before updating the noise level.
    leverage = sum(fixed_map.leverage for fixed_map in system.maps)
    gradient += (spread * (weight * leverage)).flatten(1).sum(1, dtype=torch.float64) - map_cost
    cross = system.cross_information(weighted_mean)
    response = system.solve(cross)
    map_step = system.solve(system.gradient[None])
    gradient, information = gradient - response @ system.gradient, information - response @ cross.T
    return Derivatives(at, objective, free, maps, fitted, gradient, information, map_step, response, system, scores)


def _of_the_prediction(
    at: Evaluated, free: FreeParameters, maps: list[FixedPatternMap], weight: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the derivatives of the prediction and of the maps' penalty with respect to the free parameters.

    Returns:
        ``(p, N, H, W)`` of the mean, ``(p, N, H, W)`` of the logarithm of the standard deviation, and ``(p,)`` of the
        penalty for the maps' uncertainty, in nats. Without the last, a gain would be estimated too large beside a map
        that scales with it.
    """
    prediction = at.prediction
    mean, spread = torch.empty(2, len(free), *prediction.mean.shape)
    penalty = torch.zeros(len(free), dtype=torch.float64)
    for i, (step, neighbour, shifted) in enumerate(free.neighbours(at.hypothesis)):
        mean[i] = (shifted.mean - prediction.mean) / step
        spread[i] = (shifted.deviation / prediction.deviation).log() / step
        for fixed_map in maps:
            if fixed_map.kind != "hot" and not fixed_map.of_captures:
                change = (free.model.map_jacobian(neighbour, fixed_map.name, shifted) - fixed_map.jacobian) / step
                penalty[i] += fixed_map.penalty_slope(change * weight)
    return mean, spread, penalty


def _of_a_clipped_signal(
    at: Evaluated, clipped: ClippedSignal, free: FreeParameters, fitted: torch.Tensor, log_likelihood: LogLikelihood
) -> tuple[torch.Tensor, torch.Tensor]:
    """Differentiate the log-likelihood itself where the signal saturates.

    Returns:
        what every pixel adds to the gradient, ``(p, N, H, W)``, and the information ``(p, p)`` that the spike at the
        saturation level adds.
    """
    slopes, level_slopes = [], []
    # central differences, because the log-likelihood is strongly curved over one step
    up_and_down = (free.neighbours(at.hypothesis, part) for part in (FINE_DIFFERENCE_STEPS, -FINE_DIFFERENCE_STEPS))
    for (step, _, above), (back, _, below) in zip(*up_and_down, strict=True):
        one_sided = step == back
        start = at.likelihood.log_likelihood if one_sided else log_likelihood(below)
        slopes.append((log_likelihood(above) - start) * fitted / (step if one_sided else step - back))
        level = clipped.level if above.clipped is None else above.clipped.level
        level_slopes.append(((level - clipped.level) / step).expand_as(clipped.mean).flatten())
    weight = clipped.mixed * (1 - clipped.kept) / (clipped.read.square() + 1 / 12) * fitted
    levels = torch.stack(level_slopes)
    return torch.stack(slopes), ((levels * weight.flatten()) @ levels.T).double()
