"""What a small change of the mean would gain, everything in the model free to give way."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.map_system import ChartSystem


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
        self._system = ChartSystem(fitter.charts(fit.hypothesis, fit.prediction, now), self.weight)
        mean = fitter.jacobian(fit.hypothesis, list(fit.free), fit.prediction)
        self._weighted = (mean * self.weight).flatten(1)
        self._follow = self._system.solve(self._system.cross(mean * self.weight))
        self._pull = self._system.solve(self._system.pull[None])[0]
        self._cross = self._system.cross(mean * self.weight)
        self._score = (mean * self.slope).flatten(1).sum(1).double() - self._cross @ self._pull
        information = (self._weighted @ mean.flatten(1).T).double() - self._follow @ self._cross.T
        self._inverse = torch.linalg.pinv(information, hermitian=True, rtol=1e-10)

    def each(self, changes: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Nats that each of some changes ``(K, N, H, W)`` gains alone, and by which factor: ``(K,)`` each.

        Nothing where it had to be reversed.
        """
        flat = changes.flatten(1)
        cross = self._system.cross(changes * self.weight)
        score = (flat @ self.slope.flatten()).double() - cross @ self._pull
        size = (flat.square() @ self.weight.flatten()).double() - (self._system.solve(cross) * cross).sum(1)
        own = (self._weighted @ flat.T).double() - self._follow @ cross.T
        score -= own.T @ self._inverse @ self._score
        size -= ((self._inverse @ own) * own).sum(0)
        factors = score.clamp(min=0) / size.clamp(min=1e-6)
        return 0.5 * score * factors, factors

    def gain(self, changes: torch.Tensor) -> Gain:
        """Of changes of the mean ``(K, N, H, W)``, DN per unit of their factors."""
        flat = changes.flatten(1)
        cross = torch.cat([self._system.cross((change * self.weight)[None]) for change in changes])
        score = (flat @ self.slope.flatten()).double() - cross @ self._pull
        information = torch.stack([(flat @ (change * self.weight).flatten()).double() for change in changes])
        information -= self._system.solve(cross) @ cross.T
        own = (self._weighted @ flat.T).double() - self._follow @ cross.T
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
