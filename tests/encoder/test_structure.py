"""Algorithm 1: the promise on levels and sums for every input, and the gradient."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sci_lightning.encoder.mask.structure import structure
from sci_lightning.encoder.rounding import round_half_up, straight_through
from sci_lightning.errors import BadInput


def assert_structural(mask: torch.Tensor, bits: int) -> None:
    levels = 2**bits
    assert torch.equal(mask.double().sum(0), torch.ones(mask.shape[1:], dtype=torch.float64))
    assert torch.equal(mask * levels, (mask * levels).round())
    assert mask.min() >= 0
    assert mask.max() <= (1 if bits == 1 else 1 - 1 / levels)
    if bits == 1:
        assert set(mask.unique().tolist()) <= {0.0, 1.0}


@st.composite
def real_masks(draw: st.DrawFn) -> torch.Tensor:
    """Pixels of T slots: any values, on the grid and off it, sparse, one-hot, all dark, all bright."""
    frames = draw(st.integers(2, 50))
    value = st.one_of(
        st.floats(0, 1, width=32),
        st.sampled_from([0.0, 1.0, 0.5, float(np.nextafter(np.float32(0.5), np.float32(0)))]),
        st.integers(0, 512).map(lambda level: level / 512),
    )
    sparse = draw(st.booleans())
    pixels = draw(st.lists(st.lists(value, min_size=frames, max_size=frames), min_size=1, max_size=4))
    mask = torch.tensor(pixels, dtype=torch.float32).T.contiguous()
    if sparse:
        kept = draw(st.integers(0, frames - 1))
        mask *= torch.arange(frames).unsqueeze(1) == kept
    return mask


@settings(max_examples=300, deadline=None)
@given(mask=real_masks(), bits=st.integers(1, 8))
def test_any_input_gives_a_structural_mask(mask: torch.Tensor, bits: int) -> None:
    assert_structural(structure(mask, bits), bits)


@pytest.mark.parametrize("bits", range(1, 9))
@pytest.mark.parametrize("frames", [2, 3, 8, 17, 50])
def test_many_pixels_of_several_kinds(frames: int, bits: int) -> None:
    uniform = torch.rand(frames, 40, 40)
    for mask in (uniform, uniform**6, uniform * 2 / frames, (uniform < 0.1).float(), uniform * 0, uniform * 0 + 1):
        assert_structural(structure(mask, bits), bits)


def test_printed_algorithm_by_hand() -> None:
    # 2 bits: 0.5, 0.5, 0.25 are levels 2, 2, 1; surplus 1; shares round(2/5)=0, round(2/3)=1, 0 -> 2, 1, 1
    assert structure(torch.tensor([0.5, 0.5, 0.25]), 2).tolist() == [0.5, 0.25, 0.25]
    # halves go up: 0.125 * 4 = 0.5 -> level 1, so 4 slots of it need no change
    assert structure(torch.full((4,), 0.125), 2).tolist() == [0.25] * 4
    # dark throughout: 1/L throughout, raised to a sum of 1
    assert structure(torch.zeros(2), 2).tolist() == [0.5, 0.5]


def test_light_in_one_slot_leaves_a_level_for_the_brightest_other() -> None:
    mask = structure(torch.tensor([0.0, 0.9, 0.02, 0.04]), 3)
    assert mask.tolist() == [0.0, 1 - 1 / 8, 0.0, 1 / 8]


def test_more_slots_than_levels() -> None:
    mask = structure(torch.rand(50, 8, 8), 2)
    assert_structural(mask, 2)
    assert ((mask > 0).sum(0) <= 4).all()


def test_one_bit_is_the_brightest_slot() -> None:
    assert structure(torch.tensor([0.2, 0.7, 0.7, 0.1]), 1).tolist() == [0, 1, 0, 0]


@pytest.mark.parametrize("bits", [1, 4])
def test_gradient_passes_straight_through(bits: int) -> None:
    mask = torch.rand(8, 3, 3, requires_grad=True)
    weight = torch.randn(8, 3, 3)
    (structure(mask, bits) * weight).sum().backward()
    assert torch.equal(mask.grad, weight)


@pytest.mark.parametrize("bits", [0, 9, -1, 2.0, "4", True])
def test_bits_out_of_range(bits: object) -> None:
    with pytest.raises(BadInput, match="1 to 8"):
        structure(torch.rand(8, 2, 2), bits)  # type: ignore[arg-type]


def test_one_slot_is_refused() -> None:
    with pytest.raises(BadInput, match="at least 2"):
        structure(torch.rand(1, 2, 2), 4)


def test_rounding_is_exact_below_one_half() -> None:
    below = torch.tensor(np.nextafter(np.float32(0.5), np.float32(0)))
    assert round_half_up(torch.stack([below, torch.tensor(0.5), torch.tensor(1.5), torch.tensor(2.5)])).tolist() == [
        0.0,
        1.0,
        2.0,
        3.0,
    ]


def test_straight_through_keeps_the_value_bit_for_bit() -> None:
    value, source = torch.rand(100) * 1e-7, torch.rand(100)
    assert torch.equal(straight_through(value, source), value)
