"""Fixed-pattern maps: one value for every pixel, column or row, or a smooth function, the same in every capture.

A smooth map is described by a few coordinates (:mod:`~sci_lightning.diagnosis.model.smooth_basis`), which are its
values below; a hypothesis holds the map itself. The values have a Gaussian prior of mean 0, whose standard deviation is
the one that makes the captures likeliest (empirical Bayes). Beside a black level, the offsets of rows and columns are
held to a mean of 0: else they would take over what all pixels share. Of hot pixels few are positive and all others are
0; naming one costs what it takes to say which it is. :class:`FixedPatternMap` is the state of one map during a fit;
:class:`~sci_lightning.diagnosis.model.map_system.MapSystem` solves for the values of all maps at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch

from sci_lightning.diagnosis.model.camera_model import CameraModel, Evaluated, Hypothesis, Setting
from sci_lightning.diagnosis.model.likelihood import Prediction
from sci_lightning.diagnosis.model.smooth_basis import SmoothBasis, orthonormal, prior

PRIOR_STEEPNESSES = (1.0, 2.0, 3.0, 4.0)
"""Powers of the degree with which the prior of a smooth map may fall; the most likely one counts. A steeper prior would
ask for more digits than maps in single precision have."""
CENTRING_INFORMATION_RATIO = 1e4
"""Information about the mean of centred values that is added, as a multiple of that about one of them."""
HOT_PIXEL_PENALTY_NATS = 5.0
"""Nats that the value of a hot pixel costs, beside the logarithm of the number of pixels for its place."""


@dataclass(frozen=True)
class FixedPatternMap:
    """The state of one fixed-pattern map during a fit.

    Attributes:
        name: of the effect.
        kind: ``pixel``, ``column``, ``row``, ``smooth``, or ``hot``: few values that are positive, the others 0.
        values: float64 of the map's shape on the pixels that count, in the effect's own unit; ``(K,)`` coordinates of a
            smooth map, which is one of the whole field.
        jacobian: ``(N, H, W)`` derivative of the mean with respect to the map's value at the pixel.
        likelihood_gradient: derivative of the log-likelihood with respect to each value, over the fitted pixels.
        likelihood_information: minus its second derivative; of the map's shape, as the gradient.
        std: standard deviation of the prior; unused for a hot map.
        std_error: standard error of ``std``, from the curvature of the marginal likelihood.
        penalty: nats that prior and uncertainty of the values take off the log-likelihood (marginal likelihood).
        evidence: nats by which the map raises the marginal likelihood, to second order.
        smooth: of a smooth map, the functions that its coordinates multiply.
        pixel_gradient, pixel_information: of a smooth map, what the captures say about every pixel of the whole field
            alone.
        centred: whether the values of rows or columns are held to a mean of 0.
    """

    name: str
    kind: str
    values: torch.Tensor
    jacobian: torch.Tensor
    likelihood_gradient: torch.Tensor
    likelihood_information: torch.Tensor
    std: float
    std_error: float
    penalty: float
    evidence: float
    smooth: SmoothBasis | None = None
    pixel_gradient: torch.Tensor | None = None
    pixel_information: torch.Tensor | None = None
    centred: bool = False

    @property
    def active(self) -> torch.Tensor:
        """Bool of the map's shape: values that may differ from 0."""
        if self.kind == "hot":
            return _hot(self.likelihood_gradient, self.likelihood_information, self.values)
        return torch.ones_like(self.values, dtype=torch.bool)

    @property
    def precision(self) -> torch.Tensor:
        """Information about each value with everything else known, from the captures and from the prior."""
        prior = 0.0 if self.kind == "hot" else 1 / max(self.std, 1e-9) ** 2
        return (self.likelihood_information + prior).clamp(min=1e-9)

    @property
    def variance(self) -> torch.Tensor:
        """Variance of each value with everything else known."""
        return torch.where(self.active, 1 / self.precision, 0.0)

    @property
    def gradient(self) -> torch.Tensor:
        """Gradient of the penalised log-likelihood with respect to every map value."""
        if self.kind == "hot":
            return self.likelihood_gradient
        return self.likelihood_gradient - self.values / max(self.std, 1e-9) ** 2

    @property
    def leverage(self) -> torch.Tensor:
        """``(N, H, W)`` variance of the mean, DN squared, that comes from the uncertainty of the map."""
        return self.jacobian.square() * self.pixel_variance.float()

    @property
    def pixel_variance(self) -> torch.Tensor:
        """Variance of the map, of a shape that broadcasts to ``(H, W)``."""
        return self.variance if self.smooth is None else self.smooth.variance(self.variance)

    def gather(self, field: torch.Tensor) -> torch.Tensor:
        """Sum a ``(.., N, H, W)`` field over all pixels that share one value of the map: ``(.., *map)``."""
        return self.reduce(field.sum(-3))

    def reduce(self, field: torch.Tensor) -> torch.Tensor:
        """Sum a ``(.., H, W)`` field over all pixels that share one value of the map: ``(.., *map)``."""
        return _reduce(self.kind, field) if self.smooth is None else self.smooth.reduce(field)

    def spread(self, values: torch.Tensor) -> torch.Tensor:
        """Return the map that values ``(.., *map)`` stand for, which broadcasts to ``(.., H, W)``."""
        return values if self.smooth is None else self.smooth.spread(values)

    def shared_information(self, other: FixedPatternMap, shared: torch.Tensor) -> torch.Tensor:
        """Return the information ``(S, S')`` that the values of two maps of rows, columns or smooth functions share.

        Args:
            other: the second map.
            shared: ``(H, W)`` information that they share about every pixel.
        """
        if self.smooth is not None:
            return other.reduce(self.smooth.seen * shared).flatten(1)
        if other.smooth is not None:
            return other.shared_information(self, shared).T
        if self.kind == other.kind:
            return torch.diag(self.reduce(shared).flatten())
        return shared if self.kind == "row" else shared.T

    def line_information(self, lost: torch.Tensor) -> torch.Tensor:
        """Return the information ``(S, S)`` about the values of a map of rows, columns or smooth functions.

        Args:
            lost: ``(H, W)`` information about every pixel that maps of pixels take away.
        """
        if self.smooth is None:
            matrix = torch.diag((self.precision - self.reduce(lost)).flatten())
            return matrix + CENTRING_INFORMATION_RATIO * self.precision.mean() if self.centred else matrix
        return torch.diag(self.precision) - self.smooth.gram(lost)

    def shared_variance(self, part: torch.Tensor) -> float:
        """Return the sum over all pairs of different pixels of the squared covariance of their errors by the map.

        Args:
            part: ``(N, H, W)`` the map's share of a pixel's predicted variance.
        """
        if self.smooth is None:
            return float((self.gather(part).square() - self.gather(part.square())).sum())
        weight = part.sum(0) / self.pixel_variance.clamp(min=1e-30)
        pairs = self.smooth.gram(weight).square() * self.variance[:, None] * self.variance
        return float(pairs.sum() - part.square().sum())

    def penalty_slope(self, change: torch.Tensor) -> float:
        """Return the derivative of the penalty for the values' uncertainty, nats per unit.

        Args:
            change: ``(N, H, W)`` derivative of :attr:`jacobian`, times the information about the mean.
        """
        if self.smooth is None:
            return float((self.cross_information(change[None])[0] * self.variance).sum())
        return float(((change * self.jacobian).sum(0).double() * self.pixel_variance).sum())

    def cross_information(self, weighted: torch.Tensor) -> torch.Tensor:
        """Return the information that the values share with changes of the mean, ``(K, *map)``.

        Args:
            weighted: ``(K, N, H, W)`` changes of the mean times the information about it.
        """
        return self.gather(weighted * self.jacobian).double()

    def moved(self, model: CameraModel, step: torch.Tensor) -> tuple[Setting, torch.Tensor]:
        """Return the effect's setting and its map, of the whole field, after a step of the values."""
        if self.smooth is not None:
            field = self.smooth.field(self.values + step).float()
            return {"std": min(float(field.std(correction=0)), 1.0)}, field
        values = torch.where(self.active, self.values + step, 0.0).float()
        if self.centred:
            values = values - values.mean()
        if self.kind == "hot":
            values = values.clamp(min=0)
            return {"fraction": float((values > 0).float().mean())}, model.whole(values)
        return {"std": self.std}, model.whole(values)

    def penalty_of(self, model: CameraModel, values: torch.Tensor, information: torch.Tensor) -> float:
        """Return the penalty, in nats, of another map.

        Args:
            model: knows which pixels count.
            values: the map, as a hypothesis holds it.
            information: ``(H, W)`` about its value at every pixel.
        """
        if self.kind == "hot":
            return float((values > 0).sum()) * _hot_penalty(self.values)
        if self.smooth is not None:
            return _penalty(self.smooth.coordinates(values), self.smooth.squares(information), self.std)
        return _penalty(model.windowed(values).double(), self.reduce(information).double(), self.std)


def with_means_given_away(model: CameraModel, hypothesis: Hypothesis) -> Hypothesis:
    """Return a hypothesis in which the mean of a map of rows or columns belongs to the effect that is that mean."""
    for name, values in hypothesis.maps.items():
        other = model.effects[name].centred_by
        if other not in hypothesis.effects or not (mean := float(values.mean())):
            continue
        (parameter, about), *_ = model.effects[other].about.items()
        shared = min(max(float(hypothesis.effects[other][parameter]) + mean, about.low), about.high)
        hypothesis = hypothesis.with_effect(other, {**hypothesis.effects[other], parameter: shared})
        hypothesis = hypothesis.with_effect(name, hypothesis.effects[name], values - mean)
    return hypothesis


def with_map_uncertainty(prediction: Prediction, maps: Mapping[str, FixedPatternMap]) -> Prediction:
    """Return the prediction with the maps' uncertainty in its standard deviation."""
    variance = prediction.deviation.square()
    for fixed_map in maps.values():
        variance = variance + fixed_map.leverage
    return replace(prediction, deviation=variance.sqrt()) if maps else prediction


def estimate_map(
    model: CameraModel,
    at: Evaluated,
    name: str,
    fitted: torch.Tensor,
    others: Sequence[FixedPatternMap] = (),
) -> FixedPatternMap:
    """Return the map of an effect at a hypothesis, with the prior that makes the captures likeliest.

    Args:
        model: predicts hypotheses.
        at: a hypothesis that need not contain the effect yet; its map is then taken at 0.
        name: of an effect with a map.
        fitted: ``(N, H, W)``, 1 for fitted pixels and 0 for held-out ones.
        others: maps of the hypothesis; those of pixels hold what a smooth map could say with fewer numbers.
    """
    hypothesis, likelihood = at.hypothesis, at.likelihood
    kind = model.effects[name].map_kind or ""
    centred = model.effects[name].centred_by in hypothesis.effects
    values = model.map_values(hypothesis, name)
    jacobian = model.map_jacobian(hypothesis, name, at.prediction)
    slope = (jacobian * likelihood.mean_gradient * fitted).sum(0)
    curvature = (jacobian.square() * likelihood.mean_information * fitted).sum(0)
    if kind == "smooth":
        taken = torch.zeros(2, *curvature.shape, dtype=torch.float64)
        for other in others:
            if other.kind == "pixel":
                shared = (jacobian * other.jacobian * likelihood.mean_information * fitted).sum(0)
                taken += torch.stack((other.gradient, shared)) * (shared / other.precision)
        return _smooth_map(model, name, values, jacobian, slope, curvature, (taken[0], taken[1]))
    gradient, information = (_reduce(kind, field).double() for field in (slope, curvature))
    values = model.windowed(values).double()
    if kind == "hot":
        hot = _hot(gradient, information, values)
        gains = 0.5 * (gradient + information * values).square() / information.clamp(min=1e-9)
        count = float(hot.sum())
        std, std_error = count / values.numel(), math.sqrt(max(count, 1)) / values.numel()
        penalty = float((values > 0).sum()) * _hot_penalty(values)
        evidence = float((gains - _hot_penalty(values))[hot].sum())
    else:
        from_zero = gradient + information * values
        if centred:
            from_zero = from_zero - information * (from_zero.sum() / information.sum().clamp(min=1e-9))
        std, evidence, std_error = _likeliest_prior(from_zero, information)
        penalty = _penalty(values, information, std)
    numbers = std, std_error, penalty, evidence
    return FixedPatternMap(name, kind, values, jacobian, gradient, information, *numbers, centred=centred)


def _smooth_map(
    model: CameraModel,
    name: str,
    values: torch.Tensor,
    jacobian: torch.Tensor,
    slope: torch.Tensor,
    curvature: torch.Tensor,
    taken: tuple[torch.Tensor, torch.Tensor],
) -> FixedPatternMap:
    """Return the state of a smooth map ``(H, W)`` from gradient and information about the value at every counted pixel.

    Its standard error is that of the map's standard deviation over the field. ``taken`` is the part of gradient and
    information that maps of pixels can take over: prior and standard error are those that suit what they leave.
    """
    left = (curvature - taken[1]).clamp(min=0)
    steepness, std, evidence = _smoothest_prior(model.whole(slope - taken[0]), model.whole(left), values)
    basis = SmoothBasis.of(model.whole(curvature), steepness, model.window)
    coordinates, gradient, information = basis.coordinates(values), basis.reduce(slope), basis.squares(curvature)
    factors = basis.mixing @ coordinates
    direction = basis.mixing.T @ (factors / factors.norm().clamp(min=1e-12))
    precision = basis.gram(left) + torch.eye(len(coordinates), dtype=torch.float64) / max(std, 1e-9) ** 2
    std_error = float((direction @ torch.linalg.solve(precision, direction)).sqrt()) if len(direction) else 0.0
    penalty = _penalty(coordinates, information, std)
    numbers = std, std_error, penalty, evidence
    of_pixels = model.whole(slope), model.whole(curvature)
    return FixedPatternMap(name, "smooth", coordinates, jacobian, gradient, information, *numbers, basis, *of_pixels)


def _smoothest_prior(slope: torch.Tensor, curvature: torch.Tensor, values: torch.Tensor) -> tuple[float, float, float]:
    """Return steepness and standard deviation of the prior of the largest marginal likelihood, and its gain in nats."""
    flat, degree = orthonormal(*curvature.shape)
    about = (flat * curvature.flatten().double()) @ flat.T
    along = flat @ (slope + curvature * values).flatten().double()
    best = (PRIOR_STEEPNESSES[0], 1e-6, -math.inf)
    for steepness in PRIOR_STEEPNESSES:
        spread = prior(degree, steepness)
        information, turn = torch.linalg.eigh(spread[:, None] * about * spread)
        std, evidence, _ = _likeliest_prior(turn.T @ (spread * along), information.clamp(min=0))
        if evidence > best[2]:
            best = steepness, std, evidence
    return best


def _reduce(kind: str, field: torch.Tensor) -> torch.Tensor:
    if kind == "column":
        return field.sum(-2, keepdim=True)
    return field.sum(-1, keepdim=True) if kind == "row" else field


def _hot(gradient: torch.Tensor, information: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """Return which pixels gain more log-likelihood from an offset of their own than naming them costs."""
    from_zero = gradient + information * values
    gain = 0.5 * from_zero.square() / information.clamp(min=1e-9)
    return (from_zero > 0) & (gain > _hot_penalty(values))


def _hot_penalty(values: torch.Tensor) -> float:
    """Return the nats that naming one more hot pixel costs: which one of all, and how hot."""
    return math.log(values.numel()) + HOT_PIXEL_PENALTY_NATS


def _penalty(values: torch.Tensor, information: torch.Tensor, std: float) -> float:
    """Return what a Gaussian prior and the uncertainty of the values take off the log-likelihood, in nats."""
    std = max(std, 1e-9)
    return float(0.5 * (values / std).square().sum() + 0.5 * torch.log1p(std**2 * information).sum())


def _marginal_gain(from_zero: torch.Tensor, information: torch.Tensor, std: float) -> float:
    """Return the gain of the marginal likelihood, in nats, by a map whose prior has this standard deviation."""
    shrink = std**2 / (1 + std**2 * information)
    return float(0.5 * (from_zero.square() * shrink).sum() - 0.5 * torch.log1p(std**2 * information).sum())


def _likeliest_prior(from_zero: torch.Tensor, information: torch.Tensor) -> tuple[float, float, float]:
    """Return the prior's standard deviation of the largest marginal likelihood, its gain, and its standard error.

    Args:
        from_zero: gradient of the log-likelihood with respect to each value, at a map of zeros.
        information: about each value.
    """
    grid = torch.logspace(-6, 0, 61, dtype=torch.float64).tolist()
    gains = [_marginal_gain(from_zero, information, std) for std in grid]
    best = max(range(len(grid)), key=gains.__getitem__)
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    for _ in range(40):  # golden-section search
        a, b = low + 0.382 * (high - low), low + 0.618 * (high - low)
        a_is_better = _marginal_gain(from_zero, information, a) > _marginal_gain(from_zero, information, b)
        low, high = (low, b) if a_is_better else (a, high)
    std = (low + high) / 2
    gain, step = _marginal_gain(from_zero, information, std), 0.02 * std
    below, above = (_marginal_gain(from_zero, information, std + way * step) for way in (-1, 1))
    curvature = -(above - 2 * gain + below) / step**2
    return std, gain, 1 / math.sqrt(curvature) if curvature > 0 else std
