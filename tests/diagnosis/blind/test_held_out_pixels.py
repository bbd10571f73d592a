"""Held-out pixels are disjoint and seeded, as many in every block."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.diagnosis.blind.held_out_pixels import HeldOutErrors, compare_errors, held_out_pixels
from sci_lightning.errors import BadInput


def test_folds_are_disjoint() -> None:
    folds = held_out_pixels(30, 64, share=0.05, folds=4, seed=1)
    assert folds.shape == (4, 30, 64) and int(folds.sum(0).max()) == 1
    assert (folds.sum(2) == 3).all()
    assert not torch.equal(folds, held_out_pixels(30, 64, seed=2))
    assert torch.equal(folds, held_out_pixels(30, 64, seed=1))


def test_more_folds_than_pixels_are_refused() -> None:
    with pytest.raises(BadInput, match="at most all pixels"):
        held_out_pixels(32, 64, share=0.05, folds=22)


def test_a_comparison_of_equals_says_nothing() -> None:
    held_out = held_out_pixels(48, 48)[0]
    squared = torch.where(held_out, torch.rand(3, 48, 48, generator=torch.Generator().manual_seed(0)), torch.nan)
    errors = HeldOutErrors(squared, torch.ones(3))
    same = compare_errors(errors, errors)
    assert same.p_value == 1 and same.fall == 0 and same.agree == 0
    few = compare_errors(errors.take([1]), errors.take([1]))
    assert few.snapshots == 1 and few.before == pytest.approx(errors.by_capture[1])
