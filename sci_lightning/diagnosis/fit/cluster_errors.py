"""Errors of the parameters that hold where the model is a little wrong: the sandwich estimate, over clusters of pixels.

The inverse information is the covariance of the estimates if the model of the camera and of its noise is right. In a
laboratory it is not quite: exposures jitter, targets are printed with errors, formulas are inexact. What is left is the
same in all pixels of a capture, of a level of light, or of a part of the field. Such clusters say by themselves where
the parameters should be, and how far they disagree says how far the estimates may be trusted (White, "Maximum
likelihood estimation of misspecified models", 1982; with clusters Liang and Zeger, 1986).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import torch

from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.model.capture_map import CaptureMap
from sci_lightning.diagnosis.model.fixed_pattern_map import FixedPatternMap
from sci_lightning.diagnosis.model.hypothesis import ParameterName
from sci_lightning.diagnosis.model.map_system import DENSE

LIGHT_LEVELS = 12
"""Levels of light, of equally many pixels each."""
PARTS_PER_SIDE = 4
"""Rows and columns of blocks that the field is divided into."""
MAX_DISPERSION = 1e6
"""Largest factor of the variances that is considered; below it every logarithm is as probable as any other."""
RIGHT_MODEL_PROBABILITY = 0.5
"""Prior probability that clusters disagree by no more than the noise says."""
FEW_PARAMETERS = 3
"""Parameters of an effect up to which the largest of their dispersions counts, and not the mean."""
MIN_OTHERS_SHARE = 0.1
"""Least part of the information about a value that other targets than one count as having."""
MIN_INFORMATION = 1e-9
"""Information below which the captures say nothing about a parameter."""


@dataclass(frozen=True)
class ClusterErrors:
    """Covariances of the fitted parameters' errors.

    Attributes:
        names: of the p parameters.
        model: ``(p, p)`` if the model is right: the inverse information.
        dispersions: ``(p,)`` factors of the variances by the disagreement of clusters, at least 1, of that division of
            the pixels by which they are largest.
        freedom: ``(p,)`` degrees of freedom of Student's t: infinite where the factor is certainly 1, else how many
            clusters say how large it is.
        maps: the same two numbers for the values of fixed-pattern maps together, by effect.
    """

    names: tuple[ParameterName, ...]
    model: torch.Tensor
    dispersions: torch.Tensor
    freedom: torch.Tensor
    maps: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def deviation(self, name: ParameterName) -> float:
        """Return a parameter's standard deviation (of its logarithm, where that is fitted), 0 of one that is fixed."""
        if name not in self.names:
            return 0.0
        place = self.names.index(name)
        return float((self.dispersions[place] * self.model[place, place]).clamp(min=0).sqrt())

    def of_effect(self, effect: str) -> tuple[float, float]:
        """Return dispersion and degrees of freedom of that parameter of an effect whose dispersion is largest.

        They are 1 and infinite for an effect without fitted parameters.
        """
        if effect in self.maps:
            return self.maps[effect]
        places = [place for place, (name, _) in enumerate(self.names) if name == effect]
        if not places:
            return 1.0, math.inf
        if len(places) > FEW_PARAMETERS:  # the largest of many would be large by chance
            return float(self.dispersions[places].mean()), float(self.freedom[places].min())
        worst = max(places, key=lambda place: float(self.dispersions[place]))
        return float(self.dispersions[worst]), float(self.freedom[worst])


def cluster_errors(fit: Fit) -> ClusterErrors:
    """Return the errors of the free parameters of a fit."""
    names, derivatives = fit.free, fit.derivatives
    count = len(names)
    informed = (derivatives.information.diagonal() > MIN_INFORMATION).nonzero()[:, 0]
    inverse = torch.zeros(count, count, dtype=torch.float64)
    kept = derivatives.information[informed][:, informed]
    inverse[informed[:, None], informed] = torch.linalg.pinv(kept, hermitian=True, rtol=1e-12)
    dispersions, freedom = torch.ones(count, dtype=torch.float64), torch.full((count,), math.inf, dtype=torch.float64)
    of_maps = {name: map_dispersion(fit, one) for name, one in fit.maps.items() if not one.of_captures}
    if not count:
        return ClusterErrors(names, inverse, dispersions, freedom, of_maps)
    scores = derivatives.own_scores().flatten(1).double()
    for cluster, clusters in divisions(fit):
        sums = torch.zeros(clusters, count, dtype=torch.float64).index_add_(0, cluster.flatten(), scores.T)
        sums = sums[sums.abs().sum(1) > 0]
        free = len(sums) - 1
        if free < 1:
            continue
        influence = (sums - sums.mean(0)) @ inverse
        squares = (len(sums) * influence.square().sum(0) / inverse.diagonal().clamp(min=1e-300)).tolist()
        for place in informed.tolist():
            factor, wrong = dispersion(squares[place] * free / len(sums), free)
            if factor > float(dispersions[place]):
                dispersions[place], freedom[place] = factor, free / max(wrong, 1e-9)
    return ClusterErrors(names, inverse, dispersions, freedom, of_maps)


def map_dispersion(fit: Fit, one: FixedPatternMap) -> tuple[float, float]:
    """Return how far targets disagree about the values of a map, and the degrees of freedom of that."""
    at, fitted = fit.evaluated, fit.fitter.fitted
    targets = fit.fitter.model.observation.target
    slopes, curvatures = (
        torch.zeros(int(targets.max()) + 1, *values.shape[1:]).index_add_(0, targets, values)
        for values in (
            one.jacobian * at.likelihood.mean_gradient * fitted,
            one.jacobian.square() * at.likelihood.mean_information * fitted,
        )
    )
    scores = torch.stack([one.reduce(slope).flatten() for slope in slopes]).double()
    if one.smooth is None:
        about = torch.stack([one.reduce(curvature).flatten() for curvature in curvatures]).double()
    else:
        about = torch.stack([one.smooth.squares(curvature) for curvature in curvatures]).double()
    if one.smooth is not None:  # a sheet whose own shape is in the model agrees with everybody
        shapes = [
            other.functions.member for other in fit.maps.values() if isinstance(other, CaptureMap) and other.shape
        ]
        free_of_shape = torch.ones(len(scores), dtype=torch.bool)
        for member in shapes:
            free_of_shape[targets[member]] = False
        scores, about = scores[free_of_shape], about[free_of_shape]
    total = about.sum(0)
    known = total > MIN_INFORMATION
    if one.kind == "hot":  # all others are 0, and agree about that
        known &= one.values.flatten() > 0
    scores, about, total = scores[:, known], about[:, known], total[known]
    share = about / total  # of a target in what is known about a value, which follows it to that part
    several = 1 / share.square().sum(0) - 1
    if not len(total) or float(several.sum()) < 1:
        return 1.0, math.inf
    mean = scores.sum(0) / total  # the step from where the prior holds the values
    apart = ((scores - about * mean).square() / (1 - share).clamp(min=MIN_OTHERS_SHARE)).sum(0) / total
    weight = several
    if one.kind in DENSE:  # where errors of the targets may be as large, they have taken the disagreement
        left = fit.derivatives.system.own_precision(one).diagonal() / one.precision.flatten()
        weight = several * left.clamp(min=0)[known]
    free = max(1, round(float(several.sum())))
    squares = float((apart * weight).sum() / weight.sum().clamp(min=1e-9)) * free
    factor, wrong = dispersion(squares, free)
    return factor, free / max(wrong, 1e-9)


def dispersion(squares: float, free: int) -> tuple[float, float]:
    """Return the factor of the variances that a sum of squares stands for, and how probable it is that it is not 1.

    Args:
        squares: of the distances of the clusters' estimates from their mean, summed: chi2 times the factor.
        free: degrees of freedom of that chi2.

    Returns:
        the posterior mean of the factor, and the probability that clusters disagree by more than noise.
    """
    logarithm = torch.linspace(0, math.log(MAX_DISPERSION), 400, dtype=torch.float64)
    nats = -0.5 * (free * logarithm + squares * torch.exp(-logarithm))
    weight = torch.full_like(logarithm, (1 - RIGHT_MODEL_PROBABILITY) / len(logarithm))
    weight[0] += RIGHT_MODEL_PROBABILITY
    posterior = torch.softmax(nats + weight.log(), 0)
    return float((posterior * logarithm.exp()).sum()), 1 - float(posterior[0])


def levels_of_light(mean: torch.Tensor) -> torch.Tensor:
    """Return the level of light of every pixel, 0 for the darkest, of the shape of their mean DN."""
    order = mean.flatten().argsort()
    level = torch.empty_like(order)
    level[order] = torch.arange(order.numel()) * LIGHT_LEVELS // order.numel()
    return level.view(mean.shape)


def divisions(fit: Fit) -> Iterator[tuple[torch.Tensor, int]]:
    """Yield ways to divide the pixels ``(N, H, W)``: the number of every pixel's cluster, and how many there are."""
    mean = fit.prediction.mean.contiguous()
    captures, height, width = mean.shape
    yield torch.arange(captures)[:, None, None].expand(mean.shape).contiguous(), captures
    target = fit.fitter.model.observation.target
    if (targets := int(target.max()) + 1) < captures:
        yield target[:, None, None].expand(mean.shape).contiguous(), targets
    yield levels_of_light(mean), LIGHT_LEVELS
    rows, columns = (torch.arange(side) * PARTS_PER_SIDE // side for side in (height, width))
    block = rows[:, None] * PARTS_PER_SIDE + columns
    yield block.expand(mean.shape).contiguous(), PARTS_PER_SIDE**2
