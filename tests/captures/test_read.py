"""What a captures file may hold, and what is said of one that holds something else."""

from __future__ import annotations

import re
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from sci_lightning.captures import read_captures
from sci_lightning.errors import BadInput
from tests import hostile_files
from tests.captures.conftest import SHAPE, content

N, T, H, W = SHAPE


def changed(name, index, value):
    """A dataset of the right content with one value changed."""
    array = np.array(content()[name])
    array[index] = value
    return {name: array}


def partly_nan():
    scene = content()["scene"]
    scene[1, 2] = np.nan
    return scene


def test_right_file(file):
    captures = read_captures(file())
    assert captures.patterns.dtype == np.float32 and captures.patterns.shape == (T + 1, H, W)
    assert captures.sequence.dtype == np.int64 and captures.scene.dtype == np.float32
    assert captures.measurement.dtype == np.uint8 and len(captures) == N
    assert (captures.frames, captures.size, captures.full_scale) == (T, (H, W), 255)
    assert captures.kind == ("dynamic", "static", "unknown") and captures.known.all()
    assert captures.read_noise_dn is None and captures.full_well_e is None and captures.name == "captures"


def test_only_what_is_needed(file):
    captures = read_captures(file(sequence=None, scene=None, aperture=None, exposure=None, kind=None))
    assert (captures.sequence == np.arange(T + 1)).all() and captures.frames == T + 1
    assert captures.scene.shape == (N, T + 1, H, W) and np.isnan(captures.scene).all() and not captures.known.any()
    assert (captures.aperture == 1).all() and (captures.exposure == 1).all() and captures.kind == ("unknown",) * N


@pytest.mark.parametrize(
    "changes",
    [
        {"patterns": content()["patterns"].astype(np.float64), "scene": content()["scene"].astype(np.float64)},
        {"patterns": np.ones((T + 1, H, W), bool)},
        {"sequence": content()["sequence"].astype(np.uint64), "measurement": content()["measurement"].astype(np.int32)},
        {"kind": np.array([b"dynamic", b"static", b"unknown"])},
        {"attrs": {"format": np.bytes_(b"sci-captures"), "bit_depth": np.array([8.0]), "format_version": np.uint8(1)}},
        {"attrs": {"bit_depth": 12, "read_noise_dn": 0, "full_well_e": np.float32(10500), "name": b"lab"}},
    ],
)
def test_other_types_that_will_do(file, changes):
    captures = read_captures(file(**changes))
    assert captures.patterns.dtype == captures.scene.dtype == np.float32 and captures.sequence.dtype == np.int64
    assert captures.measurement.dtype == (np.uint16 if captures.bit_depth > 8 else np.uint8)


def test_an_unknown_scene_is_nan_throughout(file):
    captures = read_captures(file(**changed("scene", 1, np.nan)))
    assert captures.known.tolist() == [True, False, True]


DN = "expected raw DN, integers from 0 to 255 (8 bits)"
WRONG = {
    "format": ({"attrs": {"format": "sci-truth"}}, "attribute 'format' is 'sci-truth', expected 'sci-captures'"),
    "no format": ({"attrs": {"format": None}}, "no attribute 'format', expected 'sci-captures': not a captures file"),
    "version": ({"attrs": {"format_version": 3}}, "attribute 'format_version' is 3, expected 1 or 2"),
    "no bits": ({"attrs": {"bit_depth": None}}, "no attribute 'bit_depth', expected a whole number from 1 to 16"),
    "17 bits": ({"attrs": {"bit_depth": 17}}, "attribute 'bit_depth' is 17, expected a whole number from 1 to 16"),
    "half bits": ({"attrs": {"bit_depth": 7.5}}, "attribute 'bit_depth' is 7.5, expected a whole number"),
    "text bits": ({"attrs": {"bit_depth": "8"}}, "attribute 'bit_depth' is '8', expected a whole number"),
    "two bits": (
        {"attrs": {"bit_depth": [8, 8]}},
        "attribute 'bit_depth' is an array of shape (2,), expected a string or one number",
    ),
    "noise": ({"attrs": {"read_noise_dn": -1.0}}, "attribute 'read_noise_dn' is -1.0, expected 0 or more"),
    "well": ({"attrs": {"full_well_e": np.nan}}, "attribute 'full_well_e' is nan, expected a positive number"),
    "name": ({"attrs": {"name": 5}}, "attribute 'name' is 5, expected a string"),
    "no patterns": (
        {"patterns": None},
        "no dataset 'patterns' (P, H, W); the file holds aperture, exposure, kind, measurement, scene, sequence",
    ),
    "no measurement": ({"measurement": None}, "no dataset 'measurement' (N, H, W); the file holds"),
    "dimensions": (
        {"measurement": np.zeros((H, W), np.uint8)},
        "'measurement' is uint8 of shape (5, 6), expected 3 dimensions (N, H, W)",
    ),
    "no captures": ({"measurement": np.zeros((0, H, W), np.uint8)}, "'measurement' is uint8 of shape (0, 5, 6), which"),
    "no pixels": ({"measurement": np.zeros((N, H, 0), np.uint8)}, "which is empty; expected (N, H, W) with at least"),
    "pattern size": (
        {"patterns": np.zeros((T, H, W + 1), np.float32)},
        "'patterns' is float32 of shape (4, 5, 7), expected (P, H, W) = (4, 5, 6)",
    ),
    "scene frames": (
        {"scene": np.zeros((N, T + 1, H, W), np.float32)},
        "'scene' is float32 of shape (3, 5, 5, 6), expected (N, T, H, W) = (3, 4, 5, 6)",
    ),
    "sequence count": (
        {"sequence": np.zeros((2, T), int)},
        "'sequence' is int64 of shape (2, 4), expected (N, T) = (3, 4)",
    ),
    "aperture count": ({"aperture": np.ones(2)}, "'aperture' is float64 of shape (2,), expected (N,) = (3,)"),
    "scalar": ({"exposure": 1.0}, "'exposure' is float64 of shape (), expected 1 dimension (N,)"),
    "kind count": ({"kind": ["dark"]}, "of shape (1,), expected (N,) = (3,)"),
    "text patterns": ({"patterns": np.full((T, H, W), b"a")}, "'patterns' is strings, expected numbers"),
    "complex scene": ({"scene": np.zeros(SHAPE, complex)}, "'scene' is complex128, expected numbers"),
    "float sequence": ({"sequence": np.zeros((N, T))}, "'sequence' is float64, expected integers"),
    "number kind": ({"kind": [1, 2, 3]}, "'kind' is int64, expected strings"),
    "NaN DN": ({"measurement": np.full((N, H, W), np.nan)}, f"'measurement' holds NaN (capture 0), {DN}"),
    "float DN": ({"measurement": np.ones((N, H, W))}, f"'measurement' is float64, {DN}"),
    "high DN": (
        {"measurement": content()["measurement"].astype(np.uint16) + 200},
        "expected raw DN, integers from 0 to 255 (8 bits)",
    ),
    "negative DN": ({"measurement": np.full((N, H, W), -1)}, f"'measurement' of capture 0 holds -1, {DN}"),
    "pattern above 1": (changed("patterns", (2, 1, 3), 1.5), "'patterns' holds 1.5 at [2, 1, 3], expected 0 to 1"),
    "pattern below 0": (changed("patterns", (0, 0, 0), -0.1), "'patterns' holds -0.1 at [0, 0, 0], expected 0 to 1"),
    "NaN pattern": (changed("patterns", (1, 0, 0), np.nan), "'patterns' holds nan at [1, 0, 0], expected 0 to 1"),
    "index high": (
        changed("sequence", (1, 2), 5),
        "'sequence' of capture 1, slot 2 is 5, expected 0 to 4 (there are 5 patterns)",
    ),
    "index low": (changed("sequence", (0, 0), -1), "'sequence' of capture 0, slot 0 is -1, expected 0 to 4"),
    "aperture": (changed("aperture", 1, -2), "'aperture' holds -2 at [1], expected finite and 0 or more"),
    "NaN aperture": (changed("aperture", 0, np.nan), "'aperture' holds nan at [0], expected finite and 0 or more"),
    "exposure": (changed("exposure", 2, np.inf), "'exposure' holds inf at [2], expected finite and 0 or more"),
    "negative scene": (
        changed("scene", (2, 0, 1, 1), -3),
        "'scene' of capture 2 holds -3 at [0, 1, 1], expected finite",
    ),
    "infinite scene": (changed("scene", (2, 0, 1, 1), np.inf), "'scene' of capture 2 holds inf at [0, 1, 1], expected"),
    "huge scene": ({"scene": np.full(SHAPE, 1e300)}, "'scene' of capture 0 holds inf at [0, 0, 0], expected finite"),
    "partly NaN": (
        {"scene": partly_nan()},
        "'scene' of capture 1 is NaN in 30 of 120 values, expected a scene that is wholly known or wholly NaN",
    ),
    "kind": (
        {"kind": ["dark", "Flat", "static"]},
        "'kind' of capture 1 is 'Flat', expected one of dark, flat, pattern, static, dynamic, unknown",
    ),
    "kind bytes": (
        {"kind": np.array([b"\xff", b"a", b"b"])},
        "'kind' holds bytes that are not UTF-8, expected strings",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_content(file, what):
    changes, message = WRONG[what]
    path = file(**changes)
    refused(path, message)


def refused(path, message):
    with pytest.raises(BadInput) as caught:
        read_captures(path)
    assert str(caught.value).startswith(f"{path}: ") and message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_value_beyond_the_bits_is_named(file):
    path = file(measurement=np.full((N, H, W), 1024, np.uint16), attrs={"bit_depth": 10})
    refused(path, "'measurement' of capture 0 holds 1024, expected raw DN, integers from 0 to 1023 (10 bits)")


def test_no_file_folder_other_format(tmp_path: Path) -> None:
    refused(tmp_path / "none.h5", "no such file")
    refused(tmp_path, "is a folder, expected a captures file (python -m sci_lightning.captures pack makes one)")
    (tmp_path / "text.h5").write_text("hello")
    refused(tmp_path / "text.h5", "not an HDF5 file, expected a captures file")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_truncated(file, share):
    path = file()
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refused(path, "not a readable HDF5 file, damaged or truncated")


def test_damaged_inside(file):
    path = file(measurement=None)
    with h5py.File(path, "a") as opened:
        values = np.random.default_rng(0).integers(0, 256, (N, H, W)).astype(np.uint8)
        opened.create_dataset("measurement", data=values, compression="gzip")
        place = opened["measurement"].id.get_chunk_info(0)
    data = bytearray(path.read_bytes())
    data[place.byte_offset : place.byte_offset + place.size] = b"\xff" * place.size
    path.write_bytes(data)
    refused(path, "'measurement' cannot be read, the file is damaged or truncated")


def test_more_than_memory(file):
    path = file(measurement=None)
    with h5py.File(path, "a") as opened:
        opened.create_dataset("measurement", (2**40, 2**10, 2**10), np.uint8, chunks=(1, 2**10, 2**10))
    refused(path, "'measurement' of shape (1099511627776, 1024, 1024) declares 1048576.0 TiB, but the file stores only")


def test_nothing_outside_the_file_is_read(file, tmp_path):
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as opened:
        opened["scene"] = content()["scene"]
    for link in (h5py.ExternalLink("secret.h5", "scene"), h5py.SoftLink("/aperture")):
        path = file(scene=None)
        with h5py.File(path, "a") as opened:
            opened["scene"] = link
        refused(path, "'scene' is a link, expected a dataset (N, T, H, W) in the file itself")
    path = file(scene=None)
    with h5py.File(path, "a") as opened:
        layout = h5py.VirtualLayout(SHAPE, np.float32)
        layout[:] = h5py.VirtualSource("secret.h5", "scene", SHAPE)
        opened.create_virtual_dataset("scene", layout)
    refused(path, "'scene' is kept in another file")
    path = file(measurement=None)
    with h5py.File(path, "a") as opened:
        opened.create_group("measurement")
    refused(path, "'measurement' is a group, expected a dataset (N, H, W)")


def test_another_name_in_messages(file):
    with pytest.raises(BadInput, match=re.escape("mine.h5: 'sequence' is float64")):
        read_captures(file(sequence=np.zeros((N, T))), called="mine.h5")


def test_neither_torch_nor_matplotlib_is_loaded() -> None:
    seen = "import sci_lightning.captures, sys; print(sorted(set(sys.modules) & {'torch', 'matplotlib', 'hydra'}))"
    done = subprocess.run([sys.executable, "-c", seen], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


READ = """
from sci_lightning.captures import read_captures as read
"""


@pytest.mark.parametrize(
    ("shape", "patterns", "written", "message"),
    [
        ((4_000_000, 4, 4), 4, False, "'measurement' declares 4000000 captures, expected at most 100000"),
        ((4_000_000, 4, 4), 4, True, "'measurement' declares 4000000 captures, expected at most 100000"),
        ((90_000, 512, 512), 1, False, "declares 22.0 GiB, but the file stores only 0 bytes for it"),
        ((90_000, 16, 16), 4000, True, "N = 90000 captures of 4000 slots, 16 x 16 pixels, declares 3"),
    ],
)
def test_a_tiny_file_that_declares_too_much(tmp_path, shape, patterns, written, message):
    with h5py.File(tmp_path / "a.h5", "w") as opened:
        opened.attrs.update(content()["attrs"])
        opened.create_dataset("patterns", data=np.zeros((patterns, *shape[1:]), np.uint8), compression="gzip")
        if written:
            opened.create_dataset("measurement", data=np.zeros(shape, np.uint8), compression="gzip")
        else:
            opened.create_dataset("measurement", shape, np.uint8, chunks=(1000, 4, 4))
    assert (tmp_path / "a.h5").stat().st_size < 1_000_000
    assert message in hostile_files.refusal(READ, tmp_path / "a.h5")


@pytest.mark.parametrize("name", ["measurement", "patterns", "sequence", "scene", "aperture"])
@pytest.mark.parametrize("how", ["external storage", "virtual dataset", "external link", "soft link"])
def test_no_dataset_may_lie_elsewhere(file, tmp_path, name, how):
    right = np.asarray(content()[name])
    path = file(**{name: None})
    (tmp_path / "secret").write_bytes(bytes(right.size))
    with h5py.File(path, "a") as opened:
        hostile_files.outside(opened, name, how, tmp_path / "secret", right.shape)
    refused(path, "is a link, expected" if "link" in how else f"'{name}' is kept in another file")


def test_labels_that_are_one_long_text(file):
    refused(file(kind=["dark", "static", "x" * 5000]), "'kind' holds strings of more than 1000 characters")


def test_flipped_bytes_end_in_one_line_or_right_captures(file):
    """Damage anywhere in the file is refused, or does not matter; HDF5 itself must survive it."""
    path = file()
    whole = path.read_bytes()
    random = np.random.default_rng(0)
    for place in random.integers(0, len(whole), 150):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << random.integers(8)
        path.write_bytes(damaged)
        try:
            read_captures(path)
        except BadInput as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize(("index", "length"), [(0, 0), (1, 2**64 - 16), (1, 2**40), (0, 2**64 - 8)])
def test_strings_without_end(file, tmp_path, index, length):
    """A chain of strings that leads back to itself keeps HDF5 busy for ever, deaf to Ctrl-C."""
    path = file()
    whole = bytearray(path.read_bytes())
    first = whole.index(b"GCOL") + 16
    whole[first : first + 2] = index.to_bytes(2, "little")
    whole[first + 8 : first + 16] = length.to_bytes(8, "little")
    path.write_bytes(whole)
    assert "its strings are damaged (an object of" in hostile_files.refusal(READ, path)


def test_a_type_that_numpy_has_no_name_for(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs.update({"format": "sci-captures", "format_version": 1, "bit_depth": 8})
        h5py.h5d.create(file.id, b"measurement", h5py.h5t.UNIX_D32LE, h5py.h5s.create_simple((1, 2, 2)))
    with pytest.raises(BadInput, match=r"'measurement' .*type that is not read"):
        read_captures(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"sci-captures", "attribute 'format' declares 4294967295 bytes"),
        (b"dark", "'kind' holds strings of more than 1000 characters"),
    ],
)
def test_strings_that_declare_gigabytes(file, text, message):
    """HDF5 allocates what a string declares, and looks for the string afterwards."""
    path = file(kind=["dark"] * 3)
    whole = bytearray(path.read_bytes())
    heap = struct.pack("<Q", whole.index(b"GCOL"))
    place = whole.index(struct.pack("<I", len(text)) + heap)
    whole[place : place + 4] = b"\xff" * 4
    path.write_bytes(whole)
    assert message in hostile_files.refusal(READ, path)


def test_strings_that_are_compressed(file):
    path = file()
    with h5py.File(path, "r+") as stored:
        del stored["kind"]
        stored.create_dataset("kind", data=["dark"] * 3, dtype=h5py.string_dtype(), chunks=(3,), compression="gzip")
    with pytest.raises(BadInput, match="'kind' is compressed or compact"):
        read_captures(path)


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"surround": "black"}, "attribute 'surround' is 'black', expected 'unknown' or 'dark'"),
        ({"surround": 1}, "attribute 'surround' is 1, expected"),
        ({"verification": [0, 99]}, "attribute 'verification' holds 99, expected a list of different whole numbers"),
        ({"verification": [-1]}, "attribute 'verification' holds -1, expected"),
        ({"verification": [1, 1]}, "attribute 'verification' holds a number twice, expected"),
        ({"verification": [0.5]}, r"attribute 'verification' is float64 of shape \(1,\), expected"),
        ({"verification": np.zeros((2, 2), int)}, r"attribute 'verification' is int64 of shape \(2, 2\), expected"),
        ({"verification": "all"}, "attribute 'verification' is .*, expected a list"),
        (
            {"sensor_to_modulator": np.eye(2)},
            r"'sensor_to_modulator' is float64 of shape \(2, 2\), expected 3 x 3 numbers",
        ),
        ({"sensor_to_modulator": "none"}, "attribute 'sensor_to_modulator' is .*, expected 3 x 3 numbers"),
        ({"sensor_to_modulator": np.zeros((3, 3))}, "sensor_to_modulator: the homography is singular"),
        (
            {"sensor_to_modulator": [[1, 0, 9], [0, 1, 0], [0, 0, 1]]},
            "maps the field of 4 x 4 pixels off the modulator",
        ),
        ({"sensor_to_modulator": np.diag([4, 4, 1])}, "'patterns' of 4 x 4 mirrors are too small for the field"),
    ],
)
def test_attributes_of_version_2(attributes: dict[str, Any], message: str, tmp_path: Path) -> None:
    """They are refused in one line if they cannot be used, and mean nothing in a file of version 1."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs.update({"format": "sci-captures", "format_version": 2, "bit_depth": 8, **attributes})
        file["patterns"], file["measurement"] = np.zeros((2, 4, 4), np.float32), np.zeros((3, 4, 4), np.uint8)
    with pytest.raises(BadInput, match=message):
        read_captures(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file.attrs["format_version"] = 1
    earlier = read_captures(tmp_path / "a.h5")
    assert earlier.surround == "unknown" and earlier.verification is None


@pytest.mark.parametrize("stated", [[], [2, 0], np.array([1], np.uint8)])
def test_verification(stated: Any, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs.update({"format": "sci-captures", "format_version": 2, "bit_depth": 8, "surround": "dark"})
        file.attrs["verification"] = np.asarray(stated, None if len(stated) else np.int64)
        file["patterns"], file["measurement"] = np.zeros((2, 4, 4), np.float32), np.zeros((3, 4, 4), np.uint8)
    captures = read_captures(tmp_path / "a.h5")
    assert captures.verification == tuple(stated) and captures.surround == "dark"
