"""Whether a mask belongs to a snapshot: real scenes with their own mask, and with masks that are not theirs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.io import loadmat

from sci_lightning.captures.mask_check import check_mask, mask_warning
from sci_lightning.encoder.mask import LearnedStructural, RandomBinary


def benchmark(folder: Path, name: str) -> tuple[torch.Tensor, torch.Tensor]:
    """The first snapshot of a scene, and the mask of its file."""
    content = loadmat(folder / "benchmark" / name)
    mask = torch.from_numpy(content["mask"].astype(np.float32)).permute(2, 0, 1)
    return torch.from_numpy(content["meas"].astype(np.float32) / 255)[..., 0], mask


def recorded(folder: Path, clip: str, mask: torch.Tensor, noise: float = 0.01) -> torch.Tensor:
    """A real clip behind a mask, with noise and rounded to 8 bits."""
    frames, side = np.load(folder / "train" / f"{clip}.npz")["frames"], mask.shape[-1]
    video = torch.from_numpy(frames[: len(mask), :side, :side].astype(np.float32)) / 255
    light = (mask * video).sum(0) / mask.sum(0).mean()
    return ((light + noise * torch.randn_like(light)).clamp(0, 1) * 255).round() / 255


@pytest.mark.parametrize("name", ["kobe8_float_rebuilt.mat", "traffic_cacti.mat", "drop8_cacti.mat"])
def test_benchmark_scenes(shared_data: Path, name: str) -> None:
    snapshot, mask = benchmark(shared_data, name)
    own = check_mask(snapshot, mask)
    assert own is not None and own.belongs and own.explained > 0.9 and own.share > 0.5
    assert mask_warning(snapshot[None], mask) == ""
    content = loadmat(shared_data / "mask" / "mask.mat")["mask"].astype(np.float32)
    for other in (torch.from_numpy(content).permute(2, 0, 1), mask.roll((9, 4), (1, 2))):
        line = mask_warning(snapshot[None], other)
        assert "does not seem to belong" in line and "orientation" in line and "shift" in line
    for words, other in {
        "shifted by -1 to the right and 2 down": mask.roll((-2, 1), (1, 2)),
        "flipped left to right": mask.flip(2),
        "transposed": mask.mT,
    }.items():
        assert f"fits this snapshot better when it is {words}" in mask_warning(snapshot[None], other)


@pytest.mark.parametrize("noise", [0.003, 0.03])
@pytest.mark.parametrize("clip", ["davis-bear", "aquarium", "motorway"])
def test_right_masks_of_every_kind_raise_no_alarm(shared_data: Path, clip: str, noise: float) -> None:
    masks = [RandomBinary(8, (128, 128))(), torch.rand(8, 128, 128), LearnedStructural(2, 8, (128, 128))().detach()]
    for mask in masks:
        assert mask_warning(recorded(shared_data, clip, mask, noise)[None], mask) == ""
    half_a_pixel_off = (masks[0] + masks[0].roll(1, 2)) / 2
    assert mask_warning(recorded(shared_data, clip, masks[0], noise)[None], half_a_pixel_off) == ""


def test_structural_masks_are_told_apart_where_the_scene_moves(shared_data: Path) -> None:
    mask = LearnedStructural(2, 8, (128, 128))().detach()
    moving, still = (recorded(shared_data, clip, mask, 0.003) for clip in ("davis-drift-straight", "aquarium"))
    assert "flipped upside down" in mask_warning(moving[None], mask.flip(1))
    check = check_mask(still, mask.flip(1).roll(9, 2))
    assert check is not None and check.share < 0.01 and check.belongs  # it cannot tell, and says nothing


def test_a_random_mask_in_the_place_of_a_structural_one(shared_data: Path) -> None:
    taken_with = LearnedStructural(2, 8, (128, 128))().detach()
    snapshot = recorded(shared_data, "davis-bear", taken_with)
    assert "does not seem to belong" in mask_warning(snapshot[None], RandomBinary(8, (128, 128))())


@pytest.mark.parametrize("order", [[0, 2, 4, 6, 1, 3, 5, 7], [5, 0, 3, 7, 2, 6, 1, 4]])
def test_slots_in_another_order(shared_data: Path, order: list[int]) -> None:
    for name in ("kobe8_float_rebuilt.mat", "aerial8_float_rebuilt.mat"):
        snapshot, mask = benchmark(shared_data, name)
        line = mask_warning(snapshot[None], mask[order])
        right = [order.index(slot) + 1 for slot in range(8)]
        right = right if right[0] < right[-1] else right[::-1]  # which way time runs cannot be told
        assert f"in the order {', '.join(map(str, right))}: check the order of the frames" in line
        assert mask_warning(snapshot[None], mask.flip(0)) == ""


def test_the_order_of_a_scene_at_rest_is_not_doubted(shared_data: Path) -> None:
    mask = RandomBinary(8, (128, 128))()
    assert mask_warning(recorded(shared_data, "aquarium", mask)[None], mask[torch.randperm(8)]) == ""


def test_what_no_answer_can_be_given_to() -> None:
    mask = RandomBinary(8, (64, 64))()
    assert check_mask(torch.zeros(64, 64), mask) is None  # nothing but black
    assert check_mask(torch.ones(64, 64), mask) is None  # nothing but white
    assert check_mask(torch.rand(24, 24), mask[:, :24, :24]) is None
    assert check_mask(torch.rand(64, 64), RandomBinary(200, (64, 64))()) is None
    assert mask_warning(torch.zeros(3, 64, 64), mask) == ""


def test_one_of_several_snapshots_does_not_outvote_the_others(shared_data: Path) -> None:
    snapshot, mask = benchmark(shared_data, "drop8_cacti.mat")
    assert mask_warning(torch.stack([snapshot, snapshot, snapshot.flip(0)]), mask) == ""
    assert mask_warning(torch.stack([snapshot, snapshot.flip(0), snapshot.flip(0)]), mask) != ""


@pytest.mark.parametrize(("red", "blue"), [(0.5, 0.7), (1.0, 0.9), (0.9, 0.8)])
@pytest.mark.parametrize("where", ["snapshot", "snapshot and mask"])
def test_a_bayer_mosaic_is_named(red: float, blue: float, where: str) -> None:
    generator = torch.Generator().manual_seed(0)
    mask = (torch.rand(8, 64, 96, generator=generator) < 0.5).float()
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(96.0), indexing="ij")
    frames = torch.stack([0.4 + 0.2 * torch.sin((x + slot) / 9) * torch.cos(y / 7) for slot in range(8)])
    filters = torch.ones(64, 96)
    filters[::2, ::2], filters[1::2, 1::2] = red, blue
    columns = torch.ones(64, 96)
    columns[:, ::2] = red  # a sensor whose columns are read by two amplifiers is no mosaic
    snapshot = (mask * frames).sum(0)
    assert "Bayer" not in mask_warning(snapshot[None], mask)
    assert "Bayer" not in mask_warning((snapshot * columns)[None], mask)
    seen = mask if where == "snapshot" else mask * filters
    assert "Bayer" in mask_warning((snapshot * filters)[None], seen)
