"""Residuals held against what a small change of the camera would do to them, capture by capture."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.significance import judge

NEGLIGIBLE = 1e-6
"""Part of the largest eigenvalue below which a combination of changes counts as none."""


class Regression:
    """Sums of a regression on k changes, over captures that are added one by one.

    The scores' variance is estimated from the squared products themselves (White, "A heteroskedasticity-consistent
    covariance matrix estimator", 1980), so that a misfit of another kind at the same pixels is not taken for this one.

    Args:
        changes: k.
    """

    def __init__(self, changes: int) -> None:
        self.total = torch.zeros(changes, dtype=torch.float64)
        self.covariance = torch.zeros(changes, changes, dtype=torch.float64)
        self.weight = torch.zeros(changes, changes, dtype=torch.float64)

    def add(self, changes: torch.Tensor, residual: torch.Tensor) -> None:
        """Take one capture: changes of its residuals ``(k, H, W)``, and the residuals ``(H, W)``."""
        flat = changes.flatten(1)
        pull = flat * residual.flatten()
        self.total += pull.sum(1, dtype=torch.float64)
        self.covariance += (pull @ pull.T).double()
        self.weight += (flat @ flat.T).double()

    def centred(self) -> Regression:
        """The same without what all changes have in common."""
        common = self.weight.sum(1)
        project = torch.eye(len(common), dtype=torch.float64) - common[:, None] / common.sum().clamp(min=1e-30)
        found = Regression(len(common))
        found.total = project @ self.total
        found.covariance = project @ self.covariance @ project.T
        found.weight = project @ self.weight @ project.T
        return found

    def answer(self, names: tuple[str, ...], axis: str, unit: str) -> Answer:
        """The changes that fit best, all k at once, and whether they are more than chance."""
        inverse = torch.linalg.pinv(self.weight, rtol=NEGLIGIBLE, hermitian=True)
        errors = (inverse @ self.covariance @ inverse).diagonal().clamp(min=0).sqrt()
        values, vectors = torch.linalg.eigh(self.covariance)
        kept = values > NEGLIGIBLE * values.max().clamp(min=1e-30)
        scores = (vectors.T @ self.total)[kept] / values[kept].sqrt()
        return judge(scores, Picture("bars", inverse @ self.total, unit, names, (axis,), errors))
