"""Captures survive being written and read, and a failed write leaves nothing."""

from __future__ import annotations

from dataclasses import fields, replace

import h5py
import numpy as np
import pytest

from sci_lightning.captures import read_captures, write_captures
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, VirtualCamera

SESSION = Session(size=(17, 24), frames=4, bit_depth=10, unknown=1, dark_exposures=(1.0, 2.0))


@pytest.fixture(scope="module")
def virtual(tmp_path_factory):
    path = tmp_path_factory.mktemp("virtual") / "camera.h5"
    simulation = VirtualCamera(SESSION, {"gain": {"factor": 1.1}}).simulate(3)
    simulation.write(path)
    return path, simulation


def same(one, other):
    for field in fields(one):
        left, right = getattr(one, field.name), getattr(other, field.name)
        if isinstance(left, np.ndarray):
            assert left.dtype == right.dtype, field.name
            np.testing.assert_array_equal(left, right, field.name)
        elif field.name != "path":
            assert left == right, field.name


def test_virtual_camera_is_read(virtual):
    path, taken = virtual
    captures = read_captures(path)
    np.testing.assert_array_equal(captures.measurement, taken.measurement)
    np.testing.assert_array_equal(captures.scene, taken.stated_scene)
    np.testing.assert_array_equal(captures.patterns, taken.acquisition.patterns)
    assert captures.kind == taken.acquisition.kind and captures.name == "virtual camera" and captures.path == path
    assert (captures.read_noise_dn, captures.full_well_e, captures.bit_depth) == (0.8, 10000, 10)
    assert captures.exposure[:4].tolist() == [1, 2, 1, 2]
    assert (~captures.known).tolist() == [kind == "unknown" for kind in captures.kind]


def test_round_trip(virtual, tmp_path):
    captures = read_captures(virtual[0])
    written = write_captures(tmp_path / "deep" / "again.h5", captures)
    same(written, captures)
    same(read_captures(tmp_path / "deep" / "again.h5"), captures)
    assert written.path == tmp_path / "deep" / "again.h5"


def test_unknown_scenes_are_not_stored(virtual, tmp_path):
    captures = read_captures(virtual[0]).take([-1])
    same(write_captures(tmp_path / "a.hdf5", captures), captures)
    with h5py.File(tmp_path / "a.hdf5") as file:
        assert "scene" not in file and file["measurement"].compression == "gzip"


def test_what_cannot_be_read_is_not_written(virtual, tmp_path):
    captures = read_captures(virtual[0])
    wrong = replace(captures, bit_depth=4)
    with pytest.raises(BadInput, match=r"a\.h5: 'measurement' of capture \d+ .* 0 to 15"):
        write_captures(tmp_path / "a.h5", wrong)
    assert not list(tmp_path.iterdir())


def test_interrupted_write_keeps_what_was_there(virtual, tmp_path, monkeypatch):
    captures = read_captures(virtual[0])
    write_captures(tmp_path / "a.h5", captures)
    before = (tmp_path / "a.h5").read_bytes()

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(h5py.File, "create_dataset", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_captures(tmp_path / "a.h5", captures)
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]
    assert (tmp_path / "a.h5").read_bytes() == before


@pytest.mark.parametrize("name", ["a.mat", "a", "folder.h5"])
def test_names(virtual, tmp_path, name):
    (tmp_path / "folder.h5").mkdir()
    with pytest.raises(BadInput, match=r"ends in \.h5 or \.hdf5"):
        write_captures(tmp_path / name, read_captures(virtual[0]))
