"""A published mask keeps its levels, whatever kind it is."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.mask import LearnedStructural, Measured, published_mask
from sci_lightning.encoder.mask.structure import structure
from sci_lightning.errors import BadInput


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_a_structural_mask_is_learned(bits: int) -> None:
    real = torch.rand(8, 16, 12)
    levels = structure(real, bits)
    mask = published_mask(levels, real, 8, (16, 12))
    assert isinstance(mask, LearnedStructural) and mask.bits == bits
    assert torch.equal(mask.weight, real) and torch.equal(mask(), levels)
    mask = published_mask(levels, None, 8, (16, 12))
    assert torch.equal(mask(), levels)


def test_the_levels_count_where_the_real_mask_leads_elsewhere() -> None:
    """The released code rounds halves to even: other levels at some pixels."""
    real = torch.rand(8, 16, 16)
    levels = structure(real, 4)
    levels[:, 3, 5] = levels[:, 3, 5].roll(1)
    mask = published_mask(levels, real, 8, (16, 16))
    assert isinstance(mask, LearnedStructural) and torch.equal(mask(), levels)
    differs = mask.weight.ne(real).any(0)
    assert differs[3, 5] and differs.sum() == 1


def test_any_other_mask_is_fixed() -> None:
    levels = (torch.rand(4, 8, 8) < 0.5).float()
    mask = published_mask(levels, torch.rand(4, 8, 8), 4, (8, 8))
    assert isinstance(mask, Measured) and torch.equal(mask(), levels)


def test_index_of_the_open_slot() -> None:
    index = torch.randint(4, (8, 8)).float()
    mask = published_mask(index, None, 4, (8, 8))
    assert isinstance(mask, LearnedStructural) and mask.bits == 1
    assert torch.equal(mask().argmax(0), index.long()) and torch.equal(mask().sum(0), torch.ones(8, 8))


def test_values_that_cover_two_by_two_pixels() -> None:
    real = torch.rand(4, 5, 6)
    mask = published_mask(structure(real, 4), real, 4, (10, 12))
    assert torch.equal(mask()[:, 3, 8], structure(real, 4)[:, 1, 4])


def test_masks_that_do_not_fit() -> None:
    with pytest.raises(BadInput, match=r"'encoder.weight'.*\(4, 8, 8\).*\(8, 8, 8\)"):
        published_mask(torch.ones(4, 8, 8), None, 8, (8, 8))
    with pytest.raises(BadInput, match=r"'encoder.weight'.*\(8, 8\).*\(4, 8, 8\)"):
        published_mask(torch.rand(8, 8), None, 4, (8, 8))
    with pytest.raises(BadInput, match="'continuous_mask', is"):
        published_mask(torch.ones(4, 8, 8), torch.ones(4, 8, 9), 4, (8, 8))
    for value in (1.5, -0.1, float("nan")):
        with pytest.raises(BadInput, match=r"\[0, 1\]"):
            published_mask(torch.full((4, 8, 8), value), None, 4, (8, 8))
