"""Masks as people have them: every way of saving the same mask gives the same transmittances, or one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch
from PIL import Image
from scipy.io import savemat
from tifffile import imwrite

from sci_lightning.errors import BadInput, InputWarning
from sci_lightning.files.array_file import ENDINGS
from sci_lightning.files.mask_file import MASK_FILES, read_mask_file, transmittance
from sci_lightning.files.modulator_files import Layout, timing_of, write_planes
from sci_lightning.files.picture_file import PICTURES

RANDOM = np.random.default_rng(0)
BINARY = (RANDOM.random((12, 24, 32)) < 0.5).astype(np.uint8)
GREY = RANDOM.integers(0, 256, (12, 24, 32)).astype(np.uint8)
GREY[0, 0, :2] = 0, 255


def save(path: Path, mask: np.ndarray) -> Path:
    """Write a mask in the format of the name, time first, a folder of pictures for none."""
    if path.suffix == ".mat":
        savemat(path, {"mask": np.moveaxis(mask, 0, -1), "meas": mask[0]})
    elif path.suffix == ".npz":
        np.savez_compressed(path, mask=mask, other=mask[0])
    elif path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            file["mask"] = mask
    elif path.suffix == ".tif":
        imwrite(path, mask, photometric="minisblack")
    elif path.suffix == ".npy":
        np.save(path, mask)
    else:
        path.mkdir()
        for number, pattern in enumerate(mask):
            Image.fromarray(pattern).save(path / f"{number}.png")  # 0, 1, .. 10, 11: not the order of the alphabet
    return path


@pytest.mark.parametrize("name", ["a.mat", "a.npz", "a.h5", "a.tif", "a.npy", "folder"])
def test_every_format_and_scale(tmp_path: Path, name: str) -> None:
    for number, (mask, expected) in enumerate(((255 * BINARY, BINARY), (BINARY, BINARY), (GREY, GREY / 255))):
        (tmp_path / str(number)).mkdir()
        path = save(tmp_path / str(number) / name, mask)
        np.testing.assert_allclose(read_mask_file(path), expected, atol=1e-6)


def test_one_name_of_pictures_in_two_formats(tmp_path: Path) -> None:
    folder = save(tmp_path / "patterns", 255 * BINARY)
    for number, pattern in enumerate(BINARY):
        Image.fromarray(255 * pattern).save(folder / f"{number}.bmp")
    (folder / "notes.txt").touch()
    with pytest.warns(InputWarning, match=r"12 .*\.png .*\.bmp; .*\.png"):
        np.testing.assert_array_equal(read_mask_file(folder), BINARY)
    np.testing.assert_array_equal(read_mask_file(folder / "*.bmp"), BINARY)
    (folder / "3.bmp").unlink()
    with pytest.raises(BadInput, match=r"12 \.png.* different names|different names"):
        read_mask_file(folder)


def test_the_folder_of_export_mask(tmp_path: Path) -> None:
    mask = torch.from_numpy(RANDOM.integers(0, 4, (3, 4, 5))).float() / 4
    write_planes(mask, 2, tmp_path, Layout((4, 5), 2, (16, 16)), timing_of(2, 2, 1.0, 1e4, 1e4))
    np.testing.assert_array_equal(read_mask_file(tmp_path), mask)


@pytest.mark.parametrize("field", [None, (24, 32)])
def test_the_other_order_of_axes(tmp_path: Path, field: tuple[int, int] | None) -> None:
    mask = BINARY[:6]  # six slots of 24 x 32: the time is by far the shortest axis
    savemat(tmp_path / "first.mat", {"mask": mask})
    np.save(tmp_path / "last.npy", np.moveaxis(mask, 0, -1))
    for name in ("first.mat", "last.npy"):
        with pytest.warns(InputWarning, match=r"read as 6 x 24 x 32 \(T x H x W\)"):
            np.testing.assert_array_equal(read_mask_file(tmp_path / name, field=field), mask)


def test_a_square_mask_and_a_cube(tmp_path: Path) -> None:
    square = (RANDOM.random((8, 64, 64)) < 0.5).astype(np.uint8)
    savemat(tmp_path / "first.mat", {"mask": square})
    savemat(tmp_path / "last.mat", {"mask": np.moveaxis(square, 0, -1)})
    known: tuple[dict[str, Any], ...] = ({}, {"frames": 8}, {"field": (64, 64)}, {"frames": 8, "field": (256, 256)})
    for settings in known:
        with pytest.warns(InputWarning, match="8 x 64 x 64"):
            np.testing.assert_array_equal(read_mask_file(tmp_path / "first.mat", **settings), square)
        np.testing.assert_array_equal(read_mask_file(tmp_path / "last.mat", **settings), square)
    savemat(tmp_path / "cube.mat", {"mask": np.moveaxis(BINARY[:, :12, :12], 0, -1)})
    np.testing.assert_array_equal(read_mask_file(tmp_path / "cube.mat", field=(12, 12)), BINARY[:, :12, :12])


def test_dn_with_a_dark_level() -> None:
    dn = 40 + 860.0 * BINARY * RANDOM.uniform(0.9, 1, BINARY.shape)
    with pytest.raises(BadInput, match=r"a: .*mask_dark=40 mask_white=8\d\d"):
        transmittance(dn, "a", settings="mask_")
    np.testing.assert_allclose(transmittance(dn, "a", 40, 900), (dn - 40) / 860, atol=1e-6)
    for dark, white, line in ((40, None, "mask_white="), (900, 40, "larger than"), (0, 200, "beyond mask_dark=0")):
        with pytest.raises(BadInput, match=line):
            transmittance(dn, "a", dark, white, "mask_")
    with pytest.raises(BadInput, match=r"mask_dark=0 mask_white=15"):
        transmittance(GREY // 16, "a", settings="mask_")
    with pytest.raises(BadInput, match=r"-1 to 1.*two exposures"):
        transmittance(1 - 2.0 * BINARY, "a")


def test_what_is_read_in_words() -> None:
    """Messages name every kind of file that is read."""
    names = {"h5": "HDF5", "tif": "TIFF", "jpg": "JPEG", "jpeg": "JPEG"}
    kinds = {ending.lstrip(".") for ending in (*ENDINGS, *PICTURES)}
    assert all(names.get(kind, kind.upper()) in MASK_FILES for kind in kinds)
