"""Maps: one number for every pixel, column or row, each with a Gaussian prior whose width is found from all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis, Prediction, Setting
from sci_lightning.diagnosis.model.likelihood import Score

STEP = 1e-3
"""Difference over which the derivative by a map's values is taken."""


@dataclass(frozen=True)
class Chart:
    """The state of one map during a fit.

    Attributes:
        name: of the effect.
        kind: ``pixel``, ``column``, ``row``, or ``hot``: few values that are positive, the others 0.
        values: the map.
        jacobian: ``(N, H, W)`` of the mean by the map's value there.
        slope, weight: of the log-likelihood by each value, the fitted pixels summed: same shape as the map.
        std: of the prior; for a hot map unused.
        std_error: of that, from the curvature of the marginal likelihood.
        cost: nats: prior and uncertainty of the values given (what the marginal likelihood takes off).
        evidence: nats gained by the map over none, to second order.
    """

    name: str
    kind: str
    values: torch.Tensor
    jacobian: torch.Tensor
    slope: torch.Tensor
    weight: torch.Tensor
    std: float
    std_error: float
    cost: float
    evidence: float

    @property
    def active(self) -> torch.Tensor:
        """Bool: values that may differ from 0."""
        if self.kind == "hot":
            return _hot(self.slope, self.weight, self.values)
        return torch.ones_like(self.values, dtype=torch.bool)

    @property
    def precision(self) -> torch.Tensor:
        """Information about each value, given everything else: the captures' and the prior's."""
        prior = 0.0 if self.kind == "hot" else 1 / max(self.std, 1e-9) ** 2
        return (self.weight + prior).clamp(min=1e-9)

    @property
    def variance(self) -> torch.Tensor:
        """Of each value given everything else."""
        return torch.where(self.active, 1 / self.precision, 0.0)

    @property
    def pull(self) -> torch.Tensor:
        """Slope of the penalised log-likelihood by each value."""
        if self.kind == "hot":
            return self.slope
        return self.slope - self.values / max(self.std, 1e-9) ** 2

    def gather(self, field: torch.Tensor) -> torch.Tensor:
        """Sum a ``(.., N, H, W)`` field over all that shares one value of the map: ``(.., *map)``."""
        return self.reduce(field.sum(-3))

    def reduce(self, field: torch.Tensor) -> torch.Tensor:
        """The same of a ``(.., H, W)`` field."""
        return _reduce(self.kind, field)

    def cross(self, weighted: torch.Tensor) -> torch.Tensor:
        """Information that the map's values share with changes of the mean ``(p, N, H, W)`` times its weight."""
        return self.gather(weighted * self.jacobian).double()

    def moved(self, step: torch.Tensor) -> tuple[Setting, torch.Tensor]:
        """The effect's setting and its map, a step on."""
        values = torch.where(self.active, self.values + step, 0.0).float()
        if self.kind == "hot":
            values = values.clamp(min=0)
            return {"fraction": float((values > 0).float().mean())}, values
        return {"std": self.std}, values

    def cost_of(self, values: torch.Tensor, weight: torch.Tensor) -> float:
        """Nats of other values, weighted otherwise."""
        if self.kind == "hot":
            return float((values > 0).sum()) * _toll(values)
        return _cost(values.double(), weight, self.std)


def derivative(model: CameraModel, hypothesis: Hypothesis, name: str, prediction: Prediction) -> torch.Tensor:
    """``(N, H, W)`` of the mean by the value there of an effect's map, which the hypothesis need not have yet."""
    values = _values(model, hypothesis, name)
    setting: Setting = {parameter: 1.0 if parameter == "std" else 0.5 for parameter in model.known[name].about}
    shifted = model.predict(hypothesis.having(name, setting, values + STEP))
    if name not in hypothesis.effects or name not in hypothesis.charts:
        prediction = model.predict(hypothesis.having(name, setting, values))
    return (shifted.mean - prediction.mean) / STEP


def _values(model: CameraModel, hypothesis: Hypothesis, name: str) -> torch.Tensor:
    values = hypothesis.charts.get(name, model.blank_chart(name))
    assert values is not None  # only effects with a map come here
    return values


def chart_of(
    model: CameraModel, hypothesis: Hypothesis, name: str, prediction: Prediction, now: Score, use: torch.Tensor
) -> Chart:
    """The map of an effect at a hypothesis, with the prior's width that makes the captures likeliest."""
    kind = model.known[name].map_kind or ""
    values = _values(model, hypothesis, name)
    jacobian = derivative(model, hypothesis, name, prediction)
    slope = _reduce(kind, (jacobian * now.slope * use).sum(0)).double()
    weight = _reduce(kind, (jacobian.square() * now.weight * use).sum(0)).double()
    known = values.double()
    if kind == "hot":
        hot = _hot(slope, weight, known)
        gained = 0.5 * (slope + weight * known).square() / weight.clamp(min=1e-9)
        evidence = float((gained - _toll(values))[hot].sum())
        count = float(hot.sum())
        return Chart(
            name,
            kind,
            known,
            jacobian,
            slope,
            weight,
            count / values.numel(),
            math.sqrt(max(count, 1)) / values.numel(),
            float((known > 0).sum()) * _toll(values),
            evidence,
        )
    pull = slope + weight * known
    std, evidence, error = _widest(pull, weight)
    return Chart(name, kind, known, jacobian, slope, weight, std, error, _cost(known, weight, std), evidence)


def _reduce(kind: str, field: torch.Tensor) -> torch.Tensor:
    if kind == "column":
        return field.sum(-2, keepdim=True)
    return field.sum(-1, keepdim=True) if kind == "row" else field


def _hot(slope: torch.Tensor, weight: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    pull = slope + weight * values
    return (pull > 0) & (0.5 * pull.square() / weight.clamp(min=1e-9) > _toll(values))


def _toll(values: torch.Tensor) -> float:
    """Nats that naming one more hot pixel costs: which one of all, and how hot."""
    return math.log(values.numel()) + 5.0


def _cost(values: torch.Tensor, weight: torch.Tensor, std: float) -> float:
    std = max(std, 1e-9)
    return float(0.5 * (values / std).square().sum() + 0.5 * torch.log1p(std**2 * weight).sum())


def _marginal(pull: torch.Tensor, weight: torch.Tensor, std: float) -> float:
    shrink = std**2 / (1 + std**2 * weight)
    return float(0.5 * (pull.square() * shrink).sum() - 0.5 * torch.log1p(std**2 * weight).sum())


def _widest(pull: torch.Tensor, weight: torch.Tensor) -> tuple[float, float, float]:
    """The prior's standard deviation of the largest marginal likelihood, its gain over 0, its standard error."""
    grid = torch.logspace(-6, 0, 61, dtype=torch.float64).tolist()
    gains = [_marginal(pull, weight, std) for std in grid]
    best = max(range(len(grid)), key=gains.__getitem__)
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    for _ in range(40):
        a, b = low + 0.382 * (high - low), low + 0.618 * (high - low)
        low, high = (low, b) if _marginal(pull, weight, a) > _marginal(pull, weight, b) else (a, high)
    std = (low + high) / 2
    gain = _marginal(pull, weight, std)
    step = 0.02 * std
    curvature = -(_marginal(pull, weight, std + step) - 2 * gain + _marginal(pull, weight, std - step)) / step**2
    return std, gain, 1 / math.sqrt(curvature) if curvature > 0 else std
