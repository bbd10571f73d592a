"""The contract of every mask in the configuration, and what is particular to some."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.encoder.mask import (
    LearnedIndex,
    LearnedStructural,
    Mask,
    Measured,
    RandomBinary,
    RandomOverlap,
    RandomStructural,
    Shifting,
    moved_pattern,
)
from sci_lightning.errors import BadInput, NoSuchCombination
from tests.conftest import members

T, H, W = 6, 12, 10


@pytest.fixture
def build(configuration: Callable[..., DictConfig], tmp_path: Path) -> Callable[..., Mask]:
    def made(name: str, *overrides: str) -> Mask:
        if name == "measured":
            np.save(tmp_path / "mask.npy", np.random.default_rng(0).random((T, H, W)))
            overrides = (*overrides, f"encoder.mask.file={tmp_path / 'mask.npy'}")
        cfg = configuration("train", f"encoder/mask={name}", f"frames={T}", f"size=[{H},{W}]", *overrides)
        return instantiate(cfg.encoder.mask, _convert_="all")

    return made


@pytest.mark.parametrize("name", members("encoder/mask"))
def test_contract(name: str, build: Callable[..., Mask]) -> None:
    mask = build(name)
    value = mask()
    assert isinstance(mask, Mask)
    assert value.shape == (T, H, W)
    assert value.dtype == torch.float32
    assert value.min() >= 0 and value.max() <= 1
    assert torch.equal(value, build(name)())  # seeded
    assert mask.automatic_aperture > 0
    assert torch.isclose((mask.automatic_aperture * value.sum(0)).mean(), torch.tensor(1.0), atol=0.15)
    copy = build(name)
    copy.load_state_dict(mask.state_dict())
    assert torch.equal(copy(), value)
    assert mask.learned == any(p.requires_grad for p in mask.parameters())
    if mask.learned:
        (value * torch.randn_like(value)).sum().backward()
        for parameter in mask.parameters():
            assert parameter.grad is not None and parameter.grad.abs().sum() > 0
            parameter.data += torch.randn_like(parameter) * 10
        mask.project_()
        assert all(p.min() >= 0 and p.max() <= 1 for p in mask.parameters())
        assert mask().min() >= 0 and mask().max() <= 1


@pytest.mark.parametrize("name", [name for name in members("encoder/mask") if name != "measured"])
def test_seed_and_tile(name: str, build: Callable[..., Mask]) -> None:
    assert not torch.equal(build(name)(), build(name, "seed=1")())
    tiled = build(name, "encoder.mask.tile=[4,3]")()
    assert tiled.shape == (T, H, W)
    assert torch.equal(tiled[:, :8, :7], tiled[:, 4:, 3:])


def test_random_binary_is_half_open() -> None:
    mask = RandomBinary(8, (100, 100))()
    assert set(mask.unique().tolist()) == {0.0, 1.0}
    assert abs(float(mask.mean()) - 0.5) < 0.01
    assert RandomBinary(8, (4, 4)).automatic_aperture == 2 / 8


@pytest.mark.parametrize("bits", range(1, 9))
def test_structural_masks_sum_to_one(bits: int) -> None:
    for mask in (RandomStructural(bits, 8, (9, 9))(), LearnedStructural(bits, 8, (9, 9))()):
        assert torch.equal(mask.sum(0), torch.ones(9, 9))
        assert mask.max() <= (1 if bits == 1 else 1 - 2.0**-bits)


@pytest.mark.usefixtures("short_design")
@pytest.mark.parametrize("settings", [{"sharpness": 4.0}, {"start": "designed"}])
def test_a_fixed_structural_mask_is_the_start_of_a_learned_one(settings: dict[str, Any]) -> None:
    """The control of learning: same seed, same mask; another seed is a random mask of the same sharpness."""
    fixed, learned = (kind(4, 8, (8, 8), seed=3, **settings)() for kind in (RandomStructural, LearnedStructural))
    assert torch.equal(fixed, learned) and not torch.equal(fixed, RandomStructural(4, 8, (8, 8), seed=3)())


def test_one_index_per_pixel_is_learned_by_the_released_gradient() -> None:
    mask = LearnedIndex(4, (1, 5))
    mask.weight.data = torch.tensor([[0.0, 0.25, 0.49, 0.75, 1.0]])
    assert mask().argmax(0).tolist() == [[0, 1, 1, 3, 3]] and torch.equal(mask().sum(0), torch.ones(1, 5))
    (mask() * torch.tensor([0.5, 3.0, -0.25, -9.0])[:, None, None]).sum().backward()
    assert mask.weight.grad is not None and mask.weight.grad.tolist() == [[-(0.5 + 1 - 0.25 - 1)] * 5]


def test_checkpoint_holds_the_real_valued_mask() -> None:
    mask = LearnedStructural(2, 8, (6, 6))
    weight = mask.state_dict()["weight"]
    assert weight.shape == (8, 6, 6) and len(weight.unique()) > 4


@pytest.mark.parametrize(("frames", "size"), [(1, (8, 8)), (8, (0, 8)), (8, (8,)), (8, 8)])
def test_impossible_shapes(frames: int, size: object) -> None:
    with pytest.raises(BadInput, match=r"at least 2|positive whole numbers"):
        RandomBinary(frames, size)  # type: ignore[arg-type]


def test_measured_reads_every_format(tmp_path: Path) -> None:
    truth = np.random.default_rng(1).random((5, 7, 9)).astype(np.float32)
    matlab = truth.transpose(1, 2, 0)
    np.save(tmp_path / "a.npy", truth)
    scipy.io.savemat(tmp_path / "b.mat", {"mask": matlab, "other": matlab})
    with h5py.File(tmp_path / "c.mat", "w") as file:  # MATLAB 7.3 is HDF5 with the axes reversed
        file["mask"] = matlab.T
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file["group/mine"] = truth
    for name in ("a.npy", "b.mat", "c.mat", "d.h5"):
        assert np.array_equal(Measured(tmp_path / name)().numpy(), truth), name
    assert np.array_equal(Measured(tmp_path / "b.mat", key="other", frames=5, size=(7, 9))().numpy(), truth)


def test_measured_real_masks(shared_data: Path) -> None:
    for name, mean in (("mask.mat", 0.5046), ("shift_mask.mat", 0.4980)):
        mask = Measured(shared_data / "mask" / name, 8, (256, 256))()
        assert abs(float(mask.mean()) - mean) < 1e-4
    assert torch.equal(mask, mask.round())


def test_measured_refuses(tmp_path: Path) -> None:
    good = np.random.default_rng(0).random((4, 6, 6))
    cases = {
        "levels.npy": (good * 255, r"\[0, 1\].*mask\.dark=.* encoder\.mask\.white="),
        "nan.npy": (np.where(good > 0.9, np.nan, good), r"holds NaN; every value must be a transmittance in \[0, 1\]"),
        "negative.npy": (good - 0.5, r"\[0, 1\]"),
        "flat.npy": (good[0], "3 dimensions"),
        "text.npy": (np.array([[["a"]]]), "numeric"),
    }
    for name, (array, message) in cases.items():
        np.save(tmp_path / name, array)
        with pytest.raises(BadInput, match=message) as caught:
            Measured(tmp_path / name)
        assert name in str(caught.value)
    np.save(tmp_path / "good.npy", good)
    with pytest.raises(BadInput, match=r"4 x 6 x 6.*the run needs 8 x 6 x 6.*frames=4"):
        Measured(tmp_path / "good.npy", frames=8)
    scipy.io.savemat(tmp_path / "two.mat", {"a": good, "b": good})
    with pytest.raises(BadInput, match=r"'mask'.*a \("):
        Measured(tmp_path / "two.mat")
    (tmp_path / "broken.mat").write_bytes((tmp_path / "two.mat").read_bytes()[:200])
    (tmp_path / "broken.npy").write_bytes((tmp_path / "good.npy").read_bytes()[:-40])
    (tmp_path / "broken.h5").write_bytes(b"\x89HDF\r\n\x1a\n1234")
    for name in ("broken.mat", "broken.npy", "broken.h5"):
        with pytest.raises(BadInput, match=f"{name}.*damaged"):
            Measured(tmp_path / name)
    with pytest.raises(BadInput, match="no such file"):
        Measured(tmp_path / "absent.npy")
    with pytest.raises(BadInput, match="use one of"):
        Measured(tmp_path / ".." / __file__)
    with pytest.raises(BadInput, match="needs a file"):
        Measured(None)


def test_pickles_are_not_read(tmp_path: Path) -> None:
    np.save(tmp_path / "objects.npy", np.array([print], dtype=object), allow_pickle=True)
    with pytest.raises(BadInput, match="3 dimensions, found object"):
        Measured(tmp_path / "objects.npy")


@pytest.mark.parametrize("name", ["random_binary", "learned_binary"])
def test_a_binary_mask_has_one_bit(name: str, build: Callable[..., Mask]) -> None:
    assert build(name).bits == build(name, "encoder.mask.bits=1").bits == 1
    kind, settings = type(build(name)), {"frames": T, "size": [H, W], "seed": 3}  # as earlier checkpoints have it
    assert torch.equal(kind(**settings)(), kind(**settings, bits=1)())
    with pytest.raises(NoSuchCombination, match=r"encoder.mask.bits=2: a binary mask has 1 bit"):
        kind(**settings, bits=2)
    with pytest.raises(BadInput, match="1 to 8"):
        kind(**settings, bits=9)


@pytest.mark.usefixtures("short_design")
@pytest.mark.parametrize("choice", ["scale=cpu", "experiment=quickstart"])
@pytest.mark.parametrize("name", members("encoder/mask"))
def test_a_scale_sets_what_the_mask_knows(choice: str, name: str, build: Callable[..., Mask]) -> None:
    assert build(name, choice, "crop=[4,4]").tile == ((8, 8) if name != "measured" else (H, W))


def test_a_pattern_that_moves_by_whole_pixels() -> None:
    for step in ((1, 0), (0, -2), (2, 1)):
        mask = Shifting(5, (20, 24), step)()
        assert set(mask.unique().tolist()) == {0.0, 1.0}
        for before, after in pairwise(mask):  # what enters is more of the pattern, not darkness
            moved = before.roll(step, (0, 1))
            assert torch.equal(after[2:, 2:-2], moved[2:, 2:-2])
        assert 0.35 < float(mask[-1, 0].mean()) < 0.65 or step[0] == 0
    tiled = Shifting(6, (12, 10), (1, 1), tile=(4, 3))()
    assert torch.equal(tiled[1, 4:8, 3:6], tiled[0, 3:7, 2:5])


def test_a_pattern_that_moves_by_part_pixels() -> None:
    """Half a pixel down: the mean of a pixel and the one above it, as the exact overlap of squares has it."""
    pattern = torch.rand(12, 10, generator=torch.Generator().manual_seed(0))
    whole = moved_pattern(pattern, 3, (10, 10), (1, 0), origin=(2, 0))
    half = moved_pattern(pattern, 3, (10, 10), (0.5, 0), origin=(2, 0))
    assert torch.allclose(half[1], (whole[0] + whole[1]) / 2) and torch.allclose(half[2], whole[1])
    gray = Shifting(4, (16, 16), (0.25, 0))()
    assert len(gray.unique()) > 2 and abs(float(gray.mean()) - 0.5) < 0.1


def test_a_measured_pattern_that_moves(tmp_path: Path) -> None:
    pattern = np.random.default_rng(0).random((20, 24)).astype(np.float32)
    np.save(tmp_path / "pattern.npy", pattern)
    mask = Shifting(5, (16, 24), (-1, 0), file=tmp_path / "pattern.npy")()
    assert all(np.array_equal(mask[slot], pattern[slot : slot + 16]) for slot in range(5))
    np.save(tmp_path / "several.npy", np.stack([pattern, pattern]))
    with pytest.raises(BadInput, match="2 patterns, expected one"):
        Shifting(5, (16, 24), file=tmp_path / "several.npy")
    with pytest.raises(BadInput, match="all slots would be equal"):
        Shifting(5, (16, 24), (0, 0))


@pytest.mark.parametrize(("overlap", "slots"), [(1 / 8, 1), (0.25, 2), (0.5, 4), (1.0, 8), (0.01, 1)])
def test_every_pixel_is_open_equally_often(overlap: float, slots: int) -> None:
    mask = RandomOverlap(8, (30, 30), overlap)
    assert torch.equal(mask().sum(0), torch.full((30, 30), float(slots)))
    assert mask.automatic_aperture == 1 / slots
    assert mask().mean((1, 2)).std() < 0.05  # all slots alike
    with pytest.raises(BadInput, match="overlap=0"):
        RandomOverlap(8, (4, 4), 0.0)
