"""What chance allows: captures that disagree a little about a laboratory widen it, captures that all misfit do not."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.diagnosis.fit.gap import largest_by_chance, scatter_of_captures


def misfits(chi2: list[float]) -> torch.Tensor:
    """Residuals ``(N, H, W)`` of captures with these reduced chi2."""
    random = torch.Generator().manual_seed(0)
    return torch.randn(len(chi2), 64, 64, generator=random) * torch.tensor(chi2).sqrt()[:, None, None]


@pytest.mark.parametrize(
    ("chi2", "within_chance"),
    [([0.9, 1.0, 1.1, 1.3, 1.0, 1.2], True), ([0.01, 130.0, 4.0, 69.0, 200.0, 2.0, 0.5, 90.0], False)],
)
def test_captures_that_disagree_widely_are_no_chance(chi2: list[float], within_chance: bool) -> None:
    residual = misfits(chi2)
    scatter = scatter_of_captures(residual, torch.ones_like(residual, dtype=torch.bool))
    assert (float(residual.square().mean()) <= largest_by_chance(1.0, scatter)) == within_chance
