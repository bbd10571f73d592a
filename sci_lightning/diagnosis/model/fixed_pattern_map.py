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

from sci_lightning.diagnosis.model.camera_model import CameraModel, Evaluated
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.diagnosis.model.likelihood import Prediction
from sci_lightning.diagnosis.model.smooth_basis import SmoothBasis

CENTRING_INFORMATION_RATIO = 1e4
"""Information about the mean of centred values that is added, as a multiple of that about one of them."""
MAX_TYPICAL_SIZES = 2.0
"""Times their typical size that errors of a laboratory may have: what is larger is a fault."""
REFINEMENTS = 8
"""Times that the search for the standard deviation of a prior looks closer, each time by a factor of 4."""
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
        of_captures: whether it is a matter of the captures, and no pattern of the camera.
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
    of_captures: bool = False

    @property
    def correction(self) -> torch.Tensor:
        """What is added to the mean of captures that no fit has seen, DN, of a shape that broadcasts to (N, H, W)."""
        return torch.zeros(1, 1, 1)

    @property
    def own_penalty(self) -> float:
        """Nats that prior and uncertainty of :attr:`correction` take off the log-likelihood of these captures."""
        return 0.0

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
        if other.of_captures:
            return other.shared_information(self, shared).T
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

    def penalty_after(self, model: CameraModel, moved: Evaluated, information: torch.Tensor) -> float:
        """Return the penalty, in nats, after a step.

        Args:
            model: knows which pixels count.
            moved: the hypothesis after the step.
            information: ``(N, H, W)`` about the mean of every pixel.
        """
        jacobian = self.jacobian  # of errors of captures, which are small, it hardly changes
        if not self.of_captures:
            jacobian = model.map_jacobian(moved.hypothesis, self.name, moved.prediction)
        squared = jacobian.square()
        return self._penalty_of(model, moved.hypothesis.maps[self.name], (squared * information).sum(0))

    def of_other_captures(self, model: CameraModel, at: Evaluated) -> FixedPatternMap:
        """Return the same map in other captures, of which a model predicts a hypothesis."""
        return replace(self, jacobian=model.map_jacobian(at.hypothesis, self.name, at.prediction))

    def _penalty_of(self, model: CameraModel, values: torch.Tensor, information: torch.Tensor) -> float:
        """Return the penalty, in nats, of another map, as a hypothesis holds it, with so much information (H, W)."""
        if self.kind == "hot":
            return float((values > 0).sum()) * hot_penalty(self.values)
        if self.smooth is not None:
            return penalty_of(self.smooth.coordinates(values), self.smooth.squares(information), self.std)
        return penalty_of(model.windowed(values).double(), self.reduce(information).double(), self.std)


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
    """Return the prediction with the maps' uncertainty in its standard deviation, and with the errors that captures
    which no fit has seen turn out to have."""
    mean, variance = prediction.mean, prediction.deviation.square()
    for fixed_map in maps.values():
        mean, variance = mean + fixed_map.correction, variance + fixed_map.leverage
    return replace(prediction, mean=mean, deviation=variance.sqrt()) if maps else prediction


def estimate_pattern(
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
        others: maps of the hypothesis; those of pixels hold what this map could say as well.
    """
    hypothesis, likelihood = at.hypothesis, at.likelihood
    kind = model.effects[name].map_kind or ""
    centred = model.effects[name].centred_by in hypothesis.effects
    values = model.map_values(hypothesis, name)
    jacobian = model.map_jacobian(hypothesis, name, at.prediction)
    slope = (jacobian * likelihood.mean_gradient * fitted).sum(0)
    curvature = (jacobian.square() * likelihood.mean_information * fitted).sum(0)
    taken = torch.zeros(2, *curvature.shape, dtype=torch.float64)
    for other in others:
        if other.kind == "pixel" and other.of_captures:
            shared = (jacobian * other.jacobian * likelihood.mean_information * fitted).sum(0)
            taken += torch.stack((other.gradient, shared)) * (shared / other.precision)
    gradient, information = (_reduce(kind, field).double() for field in (slope, curvature))
    values = model.windowed(values).double()
    if kind == "hot":
        hot = _hot(gradient, information, values)
        gains = 0.5 * (gradient + information * values).square() / information.clamp(min=1e-9)
        count = float(hot.sum())
        std, std_error = count / values.numel(), math.sqrt(max(count, 1)) / values.numel()
        penalty = float((values > 0).sum()) * hot_penalty(values)
        evidence = float((gains - hot_penalty(values))[hot].sum())
    else:
        from_zero = gradient + information * values
        if centred:
            from_zero = from_zero - information * (from_zero.sum() / information.sum().clamp(min=1e-9))
        left = (information - _reduce(kind, taken[1])).clamp(min=0)
        from_zero = from_zero - _reduce(kind, taken[0] + taken[1] * values)
        typical = getattr(model.effects[name], "typical", math.inf)
        std, evidence, std_error = likeliest_prior(from_zero, left, typical)
        penalty = penalty_of(values, information, std) + 0.5 * (std / typical) ** 2
    numbers = std, std_error, penalty, evidence
    of_captures = model.effects[name].of_captures
    return FixedPatternMap(
        name, kind, values, jacobian, gradient, information, *numbers, centred=centred, of_captures=of_captures
    )


def _reduce(kind: str, field: torch.Tensor) -> torch.Tensor:
    if kind == "column":
        return field.sum(-2, keepdim=True)
    return field.sum(-1, keepdim=True) if kind == "row" else field


def _hot(gradient: torch.Tensor, information: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """Return which pixels gain more log-likelihood from an offset of their own than naming them costs."""
    from_zero = gradient + information * values
    gain = 0.5 * from_zero.square() / information.clamp(min=1e-9)
    return (from_zero > 0) & (gain > hot_penalty(values))


def hot_penalty(values: torch.Tensor) -> float:
    """Return the nats that naming one more hot pixel costs: which one of all, and how hot."""
    return math.log(values.numel()) + HOT_PIXEL_PENALTY_NATS


def penalty_of(values: torch.Tensor, information: torch.Tensor, std: float) -> float:
    """Return what a Gaussian prior and the uncertainty of the values take off the log-likelihood, in nats."""
    std = max(std, 1e-9)
    return float(0.5 * (values / std).square().sum() + 0.5 * torch.log1p(std**2 * information).sum())


def likeliest_prior(
    from_zero: torch.Tensor, information: torch.Tensor, typical: float = math.inf
) -> tuple[float, float, float]:
    """Return the prior's standard deviation of the largest marginal likelihood, its gain, and its standard error.

    Args:
        from_zero: gradient of the log-likelihood with respect to each value, at a map of zeros.
        information: about each value.
        typical: standard deviation of a half-normal prior of the result; infinite for none. It ends at twice as much.
    """
    squares, information = from_zero.flatten().square(), information.flatten()

    def gains_of(stds: torch.Tensor) -> torch.Tensor:
        more = stds[:, None].square() * information
        shrunk = squares * (stds[:, None].square() / (1 + more))
        return 0.5 * ((shrunk - torch.log1p(more)).sum(1) - (stds / typical).square())

    grid = torch.logspace(-6, min(0.0, math.log10(MAX_TYPICAL_SIZES * typical)), 61, dtype=torch.float64)
    for _ in range(REFINEMENTS):
        best = int(gains_of(grid).argmax())
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
        grid = torch.exp(torch.linspace(float(low.log()), float(high.log()), 9, dtype=torch.float64))
    std = float(grid[4])
    below, gain, above = gains_of(std + 0.02 * std * torch.tensor([-1.0, 0.0, 1.0], dtype=torch.float64)).tolist()
    curvature = -(above - 2 * gain + below) / (0.02 * std) ** 2
    return std, gain, 1 / math.sqrt(curvature) if curvature > 0 else std
