"""Designed masks: better than where the search starts, of the right kind, and a start for masks that are learned."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.mask import LearnedBinary, LearnedStructural, design_binary, design_structural
from sci_lightning.encoder.mask.structure import structure
from sci_lightning.errors import BadInput
from sci_lightning.prior import MaskScore


@pytest.mark.parametrize("bits", [1, 2])
def test_structural(bits: int) -> None:
    steps: list[int] = []
    result = design_structural(3, bits, (4, 4), steps=12, on_progress=lambda step, score: steps.append(step))
    assert result.scores[-1] > result.scores[0] + 0.05 and steps == list(range(13))
    assert torch.equal(result.levels.sum(0), torch.ones(4, 4))
    assert torch.equal(structure(result.real, bits), result.levels)
    again = design_structural(3, bits, (4, 4), steps=12)
    assert torch.equal(again.levels, result.levels)  # the seed decides


def test_binary_keeps_its_density() -> None:
    result = design_binary(4, 0.3, (4, 4), steps=16)
    assert result.scores[-1] > result.scores[0]
    assert result.levels.unique().tolist() == [0, 1] and int(result.levels.sum()) == round(0.3 * 64)


@pytest.mark.parametrize("density", [0, 1, -0.5, 0.001])
def test_densities_that_are_refused(density: float) -> None:
    with pytest.raises(BadInput, match="density"):
        design_binary(4, density, (4, 4))


def test_a_learned_mask_starts_from_a_design(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sci_lightning.encoder.mask.design.MOST_MOVES", 2)
    mask = LearnedStructural(2, 3, (12, 20), tile=(4, 4), start="designed")
    published = LearnedStructural(2, 3, (12, 20), tile=(4, 4))
    score = MaskScore(3)
    assert score(mask()) > score(published()) + 0.1
    assert mask.weight.shape == published.weight.shape and mask.weight.requires_grad
    other = LearnedStructural(2, 3, (12, 20), tile=(4, 4), start="designed")
    assert torch.equal(other.weight, mask.weight) and other.weight.data_ptr() != mask.weight.data_ptr()
    binary = LearnedBinary(3, (4, 4), start="designed")
    assert binary().unique().tolist() == [0, 1]
    with pytest.raises(BadInput, match="start=best: choose published or designed"):
        LearnedBinary(3, (4, 4), start="best")  # type: ignore[arg-type]
