"""Captures in memory: choosing some of them."""

from __future__ import annotations

import numpy as np
import pytest

from sci_lightning.captures import read_captures


@pytest.mark.parametrize("indices", [[2, 0], np.array([2, 0]), (2, 0)])
def test_take_numbers(file, indices):
    captures = read_captures(file(aperture=np.array([1.0, 2, 3])))
    chosen = captures.take(indices)
    assert len(chosen) == 2 and chosen.kind == ("unknown", "dynamic") and chosen.aperture.tolist() == [3, 1]
    for name in ("measurement", "scene", "sequence", "exposure"):
        np.testing.assert_array_equal(getattr(chosen, name), getattr(captures, name)[[2, 0]])
    assert chosen.patterns is captures.patterns and chosen.bit_depth == 8


def test_take_booleans_and_none(file):
    captures = read_captures(file())
    assert captures.take([kind == "static" for kind in captures.kind]).kind == ("static",)
    assert len(captures.take([])) == len(captures.take([False] * 3)) == 0
    for wrong in ([3], [True]):
        with pytest.raises(IndexError):
            captures.take(wrong)
