"""Snapshots and a mask become captures without packing; a mask of another size is refused with what would fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from sci_lightning.captures.light_scale import raw_dn, step_of
from sci_lightning.captures.mask_fit import moving_masks, origin_in_mask
from sci_lightning.captures.snapshots import captures_of_snapshots, read_snapshots
from sci_lightning.errors import BadInput, InputWarning
from sci_lightning.files.picture_file import matching_files


def test_raw_dn_of_divided_values() -> None:
    dn = np.random.default_rng(0).integers(0, 4091, (1, 60, 50))
    for divisor in (4090.94, 3207.75, 255.0, 4095.0):
        values = (dn / divisor).astype(np.float32)
        assert 1 / step_of(values) == pytest.approx(divisor, rel=1e-5)
        numbers, bits = raw_dn(values, "a.mat")
        assert bits == 12 and np.array_equal(numbers, dn)
    numbers, bits = raw_dn(dn.astype(float), "a.mat", 14)
    assert bits == 14 and numbers.dtype == np.uint16 and np.array_equal(numbers, dn)
    assert raw_dn(dn.astype(np.uint16) // 17, "a.png")[1] == 8


def test_values_without_a_step_count_as_fractions() -> None:
    values = np.random.default_rng(0).random((1, 40, 40))
    numbers, bits = raw_dn(values, "a.npy")
    assert bits == 16 and np.abs(numbers / 65535 - values).max() < 1e-5


@pytest.mark.parametrize(
    ("value", "words"), [(-1.0, "0 or more"), (np.nan, "0 or more"), (17.5, "fractions up to 17.5")]
)
def test_what_is_no_dn(value: float, words: str) -> None:
    values = np.random.default_rng(0).random((1, 20, 20))
    values[0, 3, 4] = value
    with pytest.raises(BadInput, match=words):
        raw_dn(values, "a.npy")


def test_too_few_bits() -> None:
    with pytest.raises(BadInput, match="300 DN do not fit into 8 bits"):
        raw_dn(np.array([[[300, 2]]]), "a.png", 8)


def test_files_in_natural_order(tmp_path: Path) -> None:
    for number in (10, 9, 1):
        np.save(tmp_path / f"scene{number}.npy", np.full((20, 20), number, np.uint8))
    files = matching_files(tmp_path / "scene*.npy")
    assert [Path(file).name for file in files] == ["scene1.npy", "scene9.npy", "scene10.npy"]
    dn, bits = read_snapshots(files)
    assert bits == 8 and dn.shape == (3, 20, 20) and dn[:, 0, 0].tolist() == [1, 9, 10]
    np.save(tmp_path / "scene2.npy", np.ones((20, 21), np.uint8))
    with pytest.raises(BadInput, match="20 x 21 pixels, the first file has 20 x 20"):
        read_snapshots(matching_files(tmp_path / "scene*.npy"))
    with pytest.raises(BadInput, match="no such file"):
        matching_files(tmp_path / "*.tif")


def mask(size: tuple[int, int], frames: int = 4) -> np.ndarray:
    return np.random.default_rng(7).integers(0, 2, (frames, *size)).astype(np.float32)


def snapshot(patterns: np.ndarray) -> np.ndarray:
    """A snapshot of moving smooth frames, DN of 12 bits."""
    _, height, width = patterns.shape
    y, x = np.mgrid[0:height, 0:width]
    frames = [0.5 + 0.4 * np.sin((x + 2 * t) / 11) * np.cos(y / 13) for t in range(len(patterns))]
    noise = np.random.default_rng(1).standard_normal((height, width))
    return np.round(900 * (patterns * np.stack(frames)).sum(0) + 5 * noise).clip(0, 4095).astype(np.uint16)[None]


@pytest.mark.parametrize("step", [(0, 2), (0, -2), (3, 0)])
def test_a_pattern_that_moves(step: tuple[int, int], tmp_path: Path) -> None:
    pattern = mask((40, 40))[0]
    field = (40 + abs(step[0]) * 5, 40 + abs(step[1]) * 5)
    patterns = moving_masks(pattern, field, step)
    assert patterns is not None and patterns.shape == (6, *field)
    for slot, shown in enumerate(patterns):
        top, left = (slot * one if one >= 0 else (5 - slot) * -one for one in step)
        assert np.array_equal(shown[top : top + 40, left : left + 40], pattern) and shown.sum() == pattern.sum()
    savemat(tmp_path / "mask.mat", {"mask": pattern})
    captures = captures_of_snapshots(snapshot(patterns), 12, tmp_path / "mask.mat", step=step, verification=[0])
    assert captures.frames == 6 and np.array_equal(captures.patterns, patterns) and not captures.known.any()
    assert captures.verification == (0,)
    with pytest.raises(BadInput, match=r"one pattern of 40 x 40 .*mask_step="):
        captures_of_snapshots(snapshot(patterns), 12, tmp_path / "mask.mat")
    with pytest.raises(BadInput, match="does not end at the edge"):
        captures_of_snapshots(snapshot(patterns), 12, tmp_path / "mask.mat", step=(0, 7))


def test_a_pattern_as_large_as_the_snapshots_or_larger(tmp_path: Path) -> None:
    """Cameras whose mask is on a stage: T has to be said where sizes do not, and steps may be parts of pixels."""
    pattern = mask((50, 40))[0]
    np.save(tmp_path / "pattern.npy", pattern)
    dn = np.full((1, 43, 40), 9, np.uint16)
    from_edge_to_edge = captures_of_snapshots(dn, 12, tmp_path / "pattern.npy", step=(1, 0))
    assert from_edge_to_edge.frames == 8
    assert all(np.array_equal(one, pattern[7 - t : 50 - t]) for t, one in enumerate(from_edge_to_edge.patterns))
    told = captures_of_snapshots(dn, 12, tmp_path / "pattern.npy", step=(-0.5, 0), slots=3, origin=(2, 0))
    middle = (pattern[2:45] + pattern[3:46]) / 2
    assert np.allclose(told.patterns, [pattern[2:45], middle, pattern[3:46]])
    same = np.full((1, 50, 40), 9, np.uint16)
    with pytest.raises(BadInput, match="mask_slots=T"):
        captures_of_snapshots(same, 12, tmp_path / "pattern.npy", step=(1, 0))
    dark_beyond = captures_of_snapshots(same, 12, tmp_path / "pattern.npy", step=(1, 0), slots=4).patterns
    assert np.array_equal(dark_beyond[3, 3:], pattern[:-3]) and not dark_beyond[3, :3].any()
    with pytest.raises(BadInput, match="leaves the field"):
        captures_of_snapshots(same, 12, tmp_path / "pattern.npy", step=(30, 0), slots=4)
    with pytest.raises(BadInput, match="all slots would be equal"):
        captures_of_snapshots(same, 12, tmp_path / "pattern.npy", step=(0, 0), slots=4)


def test_the_first_slots_of_a_mask(tmp_path: Path) -> None:
    patterns = mask((40, 40), 6)
    np.save(tmp_path / "mask.npy", patterns)
    dn = np.full((1, 40, 40), 9, np.uint16)
    assert np.array_equal(captures_of_snapshots(dn, 12, tmp_path / "mask.npy", slots=4).patterns, patterns[:4])
    with pytest.raises(BadInput, match=r"mask_slots=7: .* has 6 patterns"):
        captures_of_snapshots(dn, 12, tmp_path / "mask.npy", slots=7)


@pytest.mark.parametrize("origin", [(9, 14), (-6, 11)])
def test_a_mask_of_another_size(origin: tuple[int, int], tmp_path: Path) -> None:
    whole = mask((100, 110))
    top, left = (max(0, -one) for one in origin)
    np.save(tmp_path / "mask.npy", whole[:, top : top + 90, left : left + 100])
    dn = snapshot(whole)[:, origin[0] + top : origin[0] + top + 70, origin[1] + left : origin[1] + left + 75]
    place = origin_in_mask(np.load(tmp_path / "mask.npy"), dn)
    assert place is not None and place[0] == origin
    with pytest.raises(BadInput, match=rf"mask_origin=\[{origin[0]},{origin[1]}\]"):
        captures_of_snapshots(dn, 12, tmp_path / "mask.npy")
    captures = captures_of_snapshots(dn, 12, tmp_path / "mask.npy", origin=origin)
    rows = 70 + min(0, origin[0])
    assert captures.size == (rows, 75) and captures.patterns.shape == (4, rows, 75)


def test_sides_of_equal_length_begin_together(tmp_path: Path) -> None:
    """A displacement of the mask's image along them is what a diagnosis finds."""
    whole = mask((100, 80))
    np.save(tmp_path / "mask.npy", whole[:, :, :75])
    with pytest.raises(BadInput, match=r"mask_origin=\[12,0\]"):
        captures_of_snapshots(snapshot(whole)[:, 12:82, 1:76], 12, tmp_path / "mask.npy")


def test_a_mask_that_belongs_to_nothing(tmp_path: Path) -> None:
    dn = snapshot(mask((64, 64)))
    random = np.random.default_rng(3)
    np.save(tmp_path / "other.npy", random.integers(0, 2, (4, 80, 80)).astype(np.float32))
    with pytest.raises(BadInput, match="no part of the one fits the other"):
        captures_of_snapshots(dn, 12, tmp_path / "other.npy")
    for name, array, words in (
        ("closed", np.zeros((4, 64, 64)), "never opens"),
        ("levels", np.full((4, 64, 64), 255.0), r"\[0, 1\]"),
        ("single", np.ones((64, 64)), "one pattern for every slot"),
    ):
        np.save(tmp_path / f"{name}.npy", array)
        with pytest.raises(BadInput, match=words):
            captures_of_snapshots(dn, 12, tmp_path / f"{name}.npy")
    np.save(tmp_path / "order.npy", np.moveaxis(mask((64, 64)), 0, -1))
    with pytest.warns(InputWarning, match="4 x 64 x 64"):
        np.testing.assert_array_equal(captures_of_snapshots(dn, 12, tmp_path / "order.npy").patterns, mask((64, 64)))
    np.save(tmp_path / "turned.npy", np.ones((4, 64, 50)))
    with pytest.raises(BadInput, match="H and W swapped"):
        captures_of_snapshots(dn[:, :50], 12, tmp_path / "turned.npy")
    np.save(tmp_path / "right.npy", mask((64, 64)))
    with pytest.raises(BadInput, match="numbered from 0 to 0"):
        captures_of_snapshots(dn, 12, tmp_path / "right.npy", verification=[1])
    with pytest.raises(BadInput, match="one that moves is"):
        captures_of_snapshots(dn, 12, tmp_path / "right.npy", step=(0, 1))


def test_fractions_beside_dn(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    np.save(tmp_path / "fractions.npy", random.random((40, 40)))
    np.save(tmp_path / "dn.npy", random.integers(0, 255, (40, 40)).astype(np.uint8))
    np.save(tmp_path / "divided.npy", random.integers(0, 255, (40, 40)) / 255)
    with pytest.raises(BadInput, match=r"dn\.npy: DN, .*fractions"):
        read_snapshots([tmp_path / "fractions.npy", tmp_path / "dn.npy"])
    assert read_snapshots([tmp_path / "divided.npy", tmp_path / "dn.npy"])[1] == 8
    dn, bits = read_snapshots([tmp_path / "fractions.npy"], None, 12)
    assert bits == 12 and 4000 < dn.max() <= 4095


def test_a_folder_with_brackets(tmp_path: Path) -> None:
    (tmp_path / "lab [2]").mkdir()
    np.save(tmp_path / "lab [2]" / "a.npy", np.ones((20, 20)))
    assert [Path(file).name for file in matching_files(tmp_path / "lab [2]" / "*.npy")] == ["a.npy"]


def test_snapshots_that_no_camera_takes(tmp_path: Path) -> None:
    for name, values, words in (
        ("black", np.zeros((64, 64), np.uint16), "the snapshot is black"),
        ("subtracted", np.random.default_rng(0).normal(100, 80, (64, 64)), "was a dark frame subtracted"),
        ("broken", np.full((64, 64), np.nan), "expected raw DN"),
    ):
        np.save(tmp_path / f"{name}.npy", values)
        with pytest.raises(BadInput, match=words):
            read_snapshots([tmp_path / f"{name}.npy"])
