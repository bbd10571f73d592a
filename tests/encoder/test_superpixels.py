"""``encoder.mask.repeat=2``: one mask value on 2 x 2 pixels, learned so and exported so."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from sci_lightning.encoder.mask import (
    LearnedBinary,
    LearnedIndex,
    LearnedStructural,
    Mask,
    RandomBinary,
    RandomStructural,
)
from sci_lightning.errors import BadInput
from sci_lightning.files.modulator_files import Layout, read_planes, timing_of, write_planes
from tests.conftest import members

KINDS: dict[str, Callable[..., Mask]] = {
    "learned_binary": LearnedBinary,
    "learned_index": LearnedIndex,
    "learned_structural": lambda *args, **settings: LearnedStructural(3, *args, **settings),
    "random_binary": RandomBinary,
    "random_structural": lambda *args, **settings: RandomStructural(3, *args, **settings),
}


def test_every_mask_of_the_program_has_superpixels() -> None:
    assert set(KINDS) == set(members("encoder/mask")) - {"measured", "random_overlap", "shifting"}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_a_superpixel_has_one_value(kind: Callable[..., Mask]) -> None:
    fine, coarse = kind(4, (4, 5), seed=1)(), kind(4, (7, 10), seed=1, repeat=2)()
    assert coarse.shape == (4, 7, 10)
    assert torch.equal(coarse[:, ::2, ::2], fine)
    assert torch.equal(coarse[:, 1::2, 1::2], fine[:, :3])
    tiled = kind(4, (7, 10), tile=(4, 6), seed=1, repeat=2)()
    assert torch.equal(tiled[:, 4:7, 6:10], tiled[:, :3, :4])


@pytest.mark.parametrize("tile", [None, (6, 4)])
def test_a_superpixel_learns_from_all_its_pixels_also_in_a_window(tile: tuple[int, int] | None) -> None:
    mask = LearnedStructural(2, 4, (12, 11), tile=tile, repeat=2)
    assert mask.weight.shape == ((4, 6, 6) if tile is None else (4, 3, 2))
    light, window, whole = torch.rand(4, 5, 6), mask.window(3, 4, 5, 6), mask()[:, 3:8, 4:10]
    assert torch.equal(window, whole)
    part, full = (torch.autograd.grad((m * light).sum(), mask.weight)[0] for m in (window, whole))
    torch.testing.assert_close(part, full)
    torch.testing.assert_close(part.sum(), light.sum())


def test_what_does_not_fit() -> None:
    with pytest.raises(BadInput, match=r"tile=\[4, 3\]: must be multiples of repeat=2"):
        RandomBinary(4, (8, 8), tile=(4, 3), repeat=2)
    with pytest.raises(BadInput, match="whole number of pixels"):
        RandomBinary(4, (8, 8), repeat=0)


def test_superpixels_on_the_mirrors_of_the_papers_prototype(tmp_path: Path) -> None:
    mask = RandomStructural(2, 2, (762, 1016), repeat=2)()
    timing = timing_of(2, 2, 50.0, 32552.0, 4069.0)
    layout = Layout((762, 1016), 1, (768, 1024))
    write_planes(mask, 2, tmp_path, layout, timing)
    assert torch.equal(read_planes(tmp_path), mask)
    shown = layout.lay_out(mask[0])
    assert layout.corner == (3, 4) and shown[:3].max() == shown[:, :4].max() == 0
    assert torch.equal(shown[3:765:2, 4:1020:2], shown[4:765:2, 5:1020:2])
