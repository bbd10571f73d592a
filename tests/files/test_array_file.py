"""One array of a file is read, and a file cannot make the reader read, allocate or run anything else."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import read_array
from sci_lightning.files.memory_bound import check_memory, check_stored, memory_bound
from tests import hostile_files
from tests.hostile_files import compressed, matlab5, matrix, npy, outside

READ = """
from sci_lightning.files.array_file import read_array
def read(path):
    read_array(path, prefer="mask", dimensions=3)
"""


def values(*shape: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)


@pytest.mark.parametrize("ending", [".mat", ".h5"])
@pytest.mark.parametrize("how", ["external storage", "virtual dataset", "external link", "soft link"])
def test_no_other_file_is_read(tmp_path: Path, ending: str, how: str) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(bytes(range(24)))
    path = tmp_path / f"mask{ending}"
    with h5py.File(path, "w") as file:
        outside(file, "mask", how, secret, (2, 3, 4))
    with pytest.raises(BadInput, match=r"kept in another file|no array named 'mask'") as caught:
        read_array(path, prefer="mask", key="mask", dimensions=3)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_only_the_wanted_array_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = values(4, 5, 3)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["deep/other"] = values(2, 2, 2)
        file["mask"] = wanted
        file["text"] = "about"
        file.create_dataset("huge", (2**20, 2**20), "f8", chunks=(64, 64))
    savemat(tmp_path / "a.mat", {"mask": wanted, "other": values(2, 2, 2), "s": {"x": 1}, "c": np.array(["a", 1], "O")})
    savemat(tmp_path / "b.mat", {"mask": wanted, "t": "text"}, do_compression=True)
    read: list[str] = []
    original = h5py.Dataset.__getitem__
    monkeypatch.setattr(h5py.Dataset, "__getitem__", lambda self, key: (read.append(self.name), original(self, key))[1])
    np.testing.assert_array_equal(read_array(tmp_path / "a.h5", prefer="mask", dimensions=3), wanted)
    assert read == ["/mask"]
    for name in ("a.mat", "b.mat"):
        np.testing.assert_array_equal(
            read_array(tmp_path / name, prefer="mask", dimensions=3), np.moveaxis(wanted, -1, 0)
        )
    with pytest.raises(BadInput, match=r"a\.mat: .*3 dimensions, found struct"):
        read_array(tmp_path / "a.mat", prefer="mask", key="s", dimensions=3)


@pytest.mark.parametrize("dtype", [">u2", "<f4", ">f8", "?", "i1", "u8", "f2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_every_type_and_order_of_npy(tmp_path: Path, dtype: str, order: str) -> None:
    array = np.asarray(values(3, 4, 5) % 2, dtype, order=order)  # type: ignore[call-overload]
    np.save(tmp_path / "a.npy", array)
    np.testing.assert_array_equal(read_array(tmp_path / "a.npy", prefer="mask", dimensions=3), array)


@pytest.mark.parametrize("compression", [False, True])
@pytest.mark.parametrize("dtype", ["u1", "i2", "u4", "i8", "f4", "f8", "?"])
def test_every_type_of_matlab(tmp_path: Path, dtype: str, compression: bool) -> None:
    array = (values(4, 5, 3) % 2).astype(dtype)
    savemat(tmp_path / "a.mat", {"mask": array, "a_long_name_for_a_variable": 1}, do_compression=compression)
    result = read_array(tmp_path / "a.mat", prefer="mask", dimensions=3)
    np.testing.assert_array_equal(result, np.moveaxis(array, -1, 0))
    savemat(tmp_path / "4.mat", {"mask": array[0].astype(float)}, format="4")
    np.testing.assert_array_equal(read_array(tmp_path / "4.mat", prefer="mask", dimensions=2), array[0])


def test_doubles_that_matlab_stores_as_bytes(tmp_path: Path) -> None:
    """MATLAB writes whole doubles as bytes; they stay doubles, else 1 would count as one of 255 levels."""
    array = (values(4, 5, 3) % 2).astype(np.uint8)
    savemat(tmp_path / "a.mat", {"mask": array})
    content = bytearray((tmp_path / "a.mat").read_bytes())
    assert content[144] == 9  # the class of the matrix: uint8
    content[144] = 6  # double
    (tmp_path / "a.mat").write_bytes(content)
    result = read_array(tmp_path / "a.mat", prefer="mask", dimensions=3)
    assert result.dtype == np.float64 and np.array_equal(result, np.moveaxis(array, -1, 0))


def test_truth_values_of_matlab(tmp_path: Path) -> None:
    array = values(4, 5, 3) % 2 > 0
    savemat(tmp_path / "a.mat", {"mask": array})
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        file["mask"] = np.moveaxis(array, -1, 0).swapaxes(1, 2).astype(np.uint8)
        file["mask"].attrs["MATLAB_class"] = np.bytes_("logical")
    for name in ("a.mat", "b.mat"):
        result = read_array(tmp_path / name, prefer="mask", dimensions=3)
        assert result.dtype == bool and np.array_equal(result, np.moveaxis(array, -1, 0))


@pytest.mark.parametrize("ending", [".npy", ".mat", ".h5"])
def test_complex_numbers(tmp_path: Path, ending: str) -> None:
    path, array = tmp_path / f"a{ending}", np.ones((2, 3, 4), complex)
    if ending == ".npy":
        np.save(path, array)
    elif ending == ".mat":
        savemat(path, {"mask": array})
    else:
        with h5py.File(path, "w") as file:
            file["mask"] = array
    with pytest.raises(BadInput, match=r"found complex|holds nothing"):
        read_array(path, prefer="mask", dimensions=3)


def hdf5(path: Path, case: str) -> Path:
    shape = (2**17, 256, 256)  # 8 GiB
    with h5py.File(path, "w") as file:
        if case == "never written":
            file.create_dataset("mask", shape, "u1")
        elif case == "never written, compressed":
            file.create_dataset("mask", shape, "u1", compression="gzip")
        elif case == "one chunk written":
            file.create_dataset("mask", shape, "u1", chunks=(1, 256, 256))[0] = 1
        elif case == "huge chunk":
            file.create_dataset("mask", (1, 4, 4), "u1", maxshape=(None,) * 3, chunks=(2**14, 256, 256))
        elif case == "unknown filter":
            plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            plist.set_chunk((1, 4, 4))
            plist.set_filter(32999, h5py.h5z.FLAG_OPTIONAL, ())
            h5py.h5d.create(file.id, b"mask", h5py.h5t.NATIVE_UINT8, h5py.h5s.create_simple((1, 4, 4)), plist)
        else:  # a chunk inflates to a thousand times its size
            dataset = file.create_dataset("mask", (4, 1024, 1024), "u1", chunks=(4, 1024, 1024), compression="gzip")
            dataset.id.write_direct_chunk((0, 0, 0), bomb(400))
    return path


def bomb(mebibytes: int) -> bytes:
    deflate = zlib.compressobj(1)
    return b"".join(deflate.compress(bytes(2**20)) for _ in range(mebibytes)) + deflate.flush()


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("never written", "declares 8.0 GiB, but the file stores only 0 bytes for it"),
        ("never written, compressed", "declares 8.0 GiB, but the file stores only 0 bytes for it"),
        ("one chunk written", "declares 8.0 GiB, but the file stores only 64.0 KiB for it"),
        ("huge chunk", "'mask' has chunks of shape (16384, 256, 256), larger than its shape (1, 4, 4)"),
        ("unknown filter", "'mask' is stored by the HDF5 filter"),
        ("bomb", "'mask' has a chunk that inflates to more than its 4194304 bytes"),
    ],
)
def test_hdf5_that_declares_too_much(tmp_path: Path, case: str, message: str) -> None:
    assert message in hostile_files.refusal(READ, hdf5(tmp_path / "a.h5", case))


HUGE = (2**15, 256, 256)
MATLAB = {
    "declared": ([matrix(b"mask", HUGE)], "'mask' of shape (32768, 256, 256) declares 16.0 GiB, but the file stores"),
    "declared, compressed": ([compressed(matrix(b"mask", HUGE))], "declares 16.0 GiB, but the file stores"),
    "longer than the file": ([b"\x0e\0\0\0\xff\xff\xff\x7f"], "damaged or truncated (136 bytes, an element ends at"),
    "bomb": (
        [compressed(matrix(b"mask", (2, 3, 4), b"\x02\0\0\0\0\0\0\x40"), zeros=600)],
        "'mask' of shape (2, 3, 4) inflates to more than its numbers",
    ),
    "bomb in the name": (
        [compressed(b"\x0e\0\0\0\0\0\0\x40", matrix(b"", (2, 3, 4))[8:-8], b"\1\0\0\0\0\0\0\x40", zeros=300)],
        "a variable's name or dimensions are too long",
    ),
    "negative": ([matrix(b"mask", (-2, 3, 4))], "a variable of shape (-2, 3, 4)"),
    "many dimensions": ([matrix(b"mask", (1,) * 2000)], "a variable's name or dimensions are too long"),
}


@pytest.mark.parametrize("case", MATLAB)
def test_matlab_that_declares_too_much(tmp_path: Path, case: str) -> None:
    elements, message = MATLAB[case]
    assert message in hostile_files.refusal(READ, matlab5(tmp_path / "a.mat", *elements))


def test_an_unneeded_bomb_is_not_read(tmp_path: Path) -> None:
    small = matrix(b"mask", (2, 3, 4), hostile_files.element(2, bytes(24)))
    bombs = compressed(matrix(b"other", (2**15, 256, 256), b"\x02\0\0\0\0\0\0\x40"), zeros=256)
    path = matlab5(tmp_path / "a.mat", bombs, small, bombs)
    assert read_array(path, prefer="mask", dimensions=3).shape == (4, 2, 3)


def test_npy_that_declares_too_much(tmp_path: Path) -> None:
    line = hostile_files.refusal(READ, npy(tmp_path / "a.npy", (2**20, 2**12, 2**12)))
    assert line.startswith(f"{tmp_path}/a.npy: ") and "(1048576, 4096, 4096) declares 17592186044416 bytes" in line
    with pytest.raises(BadInput, match="damaged or truncated"):
        read_array(npy(tmp_path / "a.npy", (2, 3, 4), bytes(23)), prefer="mask", dimensions=3)


def test_bounds() -> None:
    assert 2**28 < memory_bound() < 2**50
    check_stored("a", 2**26, 1, compressed=True)
    with pytest.raises(BadInput, match=r"^a declares .* at most .*50%"):
        check_memory("a", memory_bound() + 1)
    with pytest.raises(BadInput, match=r"a declares 100 bytes.* 99"):
        check_stored("a", 100, 99, compressed=False)


@pytest.mark.parametrize("columns", [-25, -10])
def test_a_matrix_of_version_4_that_leads_back(tmp_path: Path, columns: int) -> None:
    (tmp_path / "a.mat").write_bytes(struct.pack("<5i", 50, 1, columns, 0, 5) + b"mask\0")
    with pytest.raises(BadInput, match=f"a matrix of 1 x {columns} at byte 0"):
        read_array(tmp_path / "a.mat", prefer="mask", dimensions=2)


@pytest.mark.parametrize("kind", [14, 15, 16, 99])
def test_a_matrix_of_numbers_that_holds_none(tmp_path: Path, kind: int) -> None:
    """SciPy crashes over some of these."""
    path = matlab5(tmp_path / "a.mat", matrix(b"mask", (4, 4, 2), struct.pack("<II", kind, 32) + bytes(32)))
    with pytest.raises(BadInput, match=f"type {kind}, expected numbers"):
        read_array(path, prefer="mask", dimensions=3)


@pytest.mark.parametrize(
    ("filters", "named"),
    [
        (((1, (9,)), (2, (1,))), "gzip, shuffle"),
        (((32000, (4, 0x0105, 8)), (32000, (4, 0x0105, 8))), "lzf, lzf"),
        (((1, (9,)), (1, (9,))), "gzip, gzip"),
    ],
)
def test_chains_of_filters_that_could_hide_a_bomb(tmp_path: Path, filters: Any, named: str) -> None:
    """Shuffled after deflate, what inflates cannot be seen; twice compressed, it inflates a million times."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((2, 2, 2))
    for code, values_ in filters:
        plist.set_filter(code, 0, values_)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        space = h5py.h5s.create_simple((2, 2, 2))
        h5py.h5d.create(file.id, b"mask", h5py.h5t.NATIVE_UINT8, space, plist).write_direct_chunk((0, 0, 0), b"x" * 8)
    with pytest.raises(BadInput, match=f"stored by the HDF5 filters {named}"):
        read_array(tmp_path / "a.h5", prefer="mask", dimensions=3)


def test_filters_that_say_themselves_how_much_comes_out(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("mask", data=np.ones((2, 2, 2), "i4"), chunks=(2, 2, 2), scaleoffset=0)
    with pytest.raises(BadInput, match="scaleoffset"):
        read_array(tmp_path / "a.h5", prefer="mask", dimensions=3)


@pytest.mark.parametrize("compression", [None, "gzip", "lzf"])
@pytest.mark.parametrize("shuffle", [False, True])
def test_usual_chains_of_filters(tmp_path: Path, compression: str | None, shuffle: bool) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        more = {"compression": compression, "shuffle": shuffle, "fletcher32": True}
        file.create_dataset("mask", data=values(2, 4, 4), chunks=(1, 4, 4), **more)
    assert np.array_equal(read_array(tmp_path / "a.h5", prefer="mask", dimensions=3), values(2, 4, 4))


def test_groups_that_are_nested_deeply_or_in_circles(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["mask"] = values(2, 4, 4)
        file["circle/back"] = file["/"]
    assert read_array(tmp_path / "a.h5", prefer="mask", dimensions=3).shape == (2, 4, 4)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        group = file
        for _ in range(40):
            group = group.create_group("g")
    with pytest.raises(BadInput, match="more than 32 deep"):
        read_array(tmp_path / "a.h5", prefer="mask", dimensions=3)


@pytest.mark.parametrize("shuffle", [False, True])
@pytest.mark.parametrize("fletcher32", [False, True])
def test_lzf_of_every_kind(tmp_path: Path, shuffle: bool, fletcher32: bool) -> None:
    random = np.random.default_rng(0)
    noise = random.integers(0, 2**15, (2, 600, 700)).astype(np.uint16)  # stored as it is: nothing is gained
    ramp = random.integers(0, 4, (4, 600, 700)).cumsum(2).astype(np.uint16)
    for name, values in (("noise", noise), ("ramp", ramp), ("even", 0 * ramp)):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            kept = {"compression": "lzf", "shuffle": shuffle, "fletcher32": fletcher32}
            file.create_dataset("mask", data=values, chunks=(1, 600, 700), **kept)
        np.testing.assert_array_equal(read_array(tmp_path / f"{name}.h5", prefer="mask", dimensions=3), values)


def test_lzf_that_inflates_again_and_again(tmp_path: Path) -> None:
    """Without a check 2.9 MB take a minute: the filter begins again with a little more memory 88 times."""
    path = tmp_path / "a.h5"
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plist.set_chunk((16, 256, 256))
    plist.set_filter(h5py.h5z.FILTER_LZF, h5py.h5z.FLAG_OPTIONAL)
    with h5py.File(path, "w") as file:
        space = h5py.h5s.create_simple((160, 256, 256))
        item = h5py.h5d.create(file.id, b"mask", h5py.h5t.NATIVE_UINT8, space, plist)
        item.write_direct_chunk((0, 0, 0), b"\x00a" + b"\xe0\xff\x00" * 950_000)
    assert "inflates to more than its 1048576 bytes" in hostile_files.refusal(READ, path)
    whole = path.read_bytes()
    at = whole.index(struct.pack("<II", 261, 2**20)) + 4  # version of LZF, bytes of a chunk
    path.write_bytes(whole[:at] + struct.pack("<I", 1) + whole[at + 4 :])
    assert "lzf without the size of its chunks" in hostile_files.refusal(READ, path)
