"""What a small change of the mean would gain, everything in the model free to give way."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.fit import Fit, Fitter


@dataclass(frozen=True)
class Gain:
    """The best linear combination of some changes.

    Attributes:
        nats: gained.
        factors: ``(K,)`` of each change.
        deviations: ``(K,)`` their standard deviations; infinite where the captures say nothing.
        score: ``(K,)`` slope by each factor, and information: ``(K, K)`` about them, all else eliminated.
    """

    nats: float
    factors: torch.Tensor
    deviations: torch.Tensor
    score: torch.Tensor
    information: torch.Tensor

    def of(self, kept: torch.Tensor) -> Gain:
        """With some of the changes (indices) only."""
        return solve(self.score[kept], self.information[kept][:, kept])


class Linear:
    """Score tests around a fit.

    Args:
        fitter: of the captures.
        fit: at its optimum.
    """

    def __init__(self, fitter: Fitter, fit: Fit) -> None:
        now = fitter.score(fit.prediction)
        self.weight = now.weight * fitter.use
        self.slope = now.slope * fitter.use
        self.value = now.value
        self._charts = fitter.charts(fit.hypothesis, fit.prediction, now)
        mean, _ = fitter.jacobian(fit.hypothesis, list(fit.free), fit.prediction)
        self._weighted = (mean * self.weight).flatten(1)
        self._crosses = [chart.cross(mean * self.weight).flatten(1) for chart in self._charts]
        slope, information = (mean * self.slope).flatten(1).sum(1).double(), self._gram(mean, self._crosses)
        for chart, cross in zip(self._charts, self._crosses, strict=True):
            slope -= (cross * (chart.response * chart.pull).flatten()).sum(1)
        self._inverse = torch.linalg.pinv(information, hermitian=True, rtol=1e-10)
        self._score = slope

    def _gram(self, mean: torch.Tensor, crosses: list[torch.Tensor]) -> torch.Tensor:
        information = (self._weighted @ mean.flatten(1).T).double()
        for chart, own, cross in zip(self._charts, self._crosses, crosses, strict=True):
            information -= own * chart.response.flatten() @ cross.T
        return information

    def each(self, changes: torch.Tensor) -> torch.Tensor:
        """Nats that each of some changes ``(K, N, H, W)`` gains alone, ``(K,)``; none where it had to be reversed."""
        flat = changes.flatten(1)
        score = (flat @ self.slope.flatten()).double()
        size = (flat.square() @ self.weight.flatten()).double()
        crosses = [chart.cross(changes * self.weight).flatten(1) for chart in self._charts]
        for chart, cross in zip(self._charts, crosses, strict=True):
            score -= (cross * (chart.response * chart.pull).flatten()).sum(1)
            size -= (cross.square() * chart.response.flatten()).sum(1)
        own = self._gram(changes, crosses)
        score -= own.T @ self._inverse @ self._score
        size -= ((self._inverse @ own) * own).sum(0)
        return 0.5 * score.clamp(min=0).square() / size.clamp(min=1e-6)

    def gain(self, changes: torch.Tensor) -> Gain:
        """Of changes of the mean ``(K, N, H, W)``, DN per unit of their factors."""
        score = torch.stack([(change * self.slope).sum(dtype=torch.float64) for change in changes])
        rows = [(changes.flatten(1) @ (change * self.weight).flatten()).double() for change in changes]
        information = torch.stack(rows)
        crosses = [
            torch.cat([chart.cross((change * self.weight)[None]).flatten(1) for change in changes])
            for chart in self._charts
        ]
        for chart, cross in zip(self._charts, crosses, strict=True):
            score -= (cross * (chart.response * chart.pull).flatten()).sum(1)
            information -= cross * chart.response.flatten() @ cross.T
        own = self._gram(changes, crosses)
        score -= own.T @ self._inverse @ self._score
        information -= own.T @ self._inverse @ own
        return solve(score, information)


def solve(score: torch.Tensor, information: torch.Tensor) -> Gain:
    """The Newton step and what it gains; directions without information stay where they are."""
    size = information.diagonal().clamp(min=1e-12).sqrt()
    scaled = information / size / size[:, None]
    inverse = torch.linalg.pinv(scaled, hermitian=True, rtol=1e-6) / size / size[:, None]
    factors = inverse @ score
    deviations = inverse.diagonal().clamp(min=0).sqrt()
    deviations = torch.where((deviations > 0) & (size > 1e-5), deviations, torch.inf)
    return Gain(0.5 * float(score @ factors), factors, deviations, score, information)
