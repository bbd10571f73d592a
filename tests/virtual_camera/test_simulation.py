"""The captures file is as documented, what is hidden is beside it and not in it, and a seed gives the same file."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from sci_lightning.captures import read_captures
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import EFFECTS, Session, VirtualCamera

SESSION = Session(size=(17, 24), frames=4, bit_depth=10, unknown=1, dark_exposures=(1.0, 2.0))
STATED = {"format", "format_version", "bit_depth", "name", "surround"}
HIDDEN = {"mask_shift": {"dx": 0.61, "dy": -0.35}, "read_noise": {"std": 2.3}, "prnu": {"std": 0.02}}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("captures") / "camera.h5"
    assert VirtualCamera(SESSION, HIDDEN).write(path, seed=7) == path.with_name("camera.truth.json")
    return path


def test_format(path: Path) -> None:
    count, slots, size = sum(SESSION.counts.values()), 4, (17, 24)
    with h5py.File(path) as file:
        assert (
            file.attrs["format"] == "sci-captures"
            and file.attrs["format_version"] == 2
            and file.attrs["surround"] == "unknown"
        )
        assert file.attrs["bit_depth"] == 10 and file.attrs["name"] == "virtual camera"
        stored = {name: (data.dtype, data.shape) for name, data in file.items() if name != "kind"}
        assert stored == {
            "patterns": (np.float32, (slots + 2, *size)),
            "sequence": (np.int64, (count, slots)),
            "measurement": (np.uint16, (count, *size)),
            "scene": (np.float32, (count, slots, *size)),
            "aperture": (np.float32, (count,)),
            "exposure": (np.float32, (count,)),
        }
        assert h5py.check_string_dtype(file["kind"].dtype) is not None
        kind = file["kind"].asstr()[:]
        assert set(kind) == {"dark", "flat", "pattern", "static", "dynamic", "unknown"}
        patterns, sequence, scene = (file[name][:] for name in ("patterns", "sequence", "scene"))
        aperture, measurement = file["aperture"][:], file["measurement"][:]
    assert patterns.min() >= 0 and patterns.max() <= 1
    assert (patterns[slots] == 0).all() and (patterns[slots + 1] == 1).all()
    assert measurement.max() < 1024
    assert (np.isnan(scene).all((1, 2, 3)) == (kind == "unknown")).all()
    nominal = (patterns[sequence] * scene).sum(1) * aperture[:, None, None]
    assert np.nanmean(np.abs(measurement / 1023 - np.clip(nominal, 0, 1))) < 0.06


def test_captures_in_memory_are_those_of_the_file(path: Path) -> None:
    in_memory, read = VirtualCamera(SESSION, HIDDEN).capture(seed=7), read_captures(path)
    for name in ("patterns", "sequence", "measurement", "scene", "aperture", "exposure"):
        np.testing.assert_array_equal(getattr(in_memory, name), getattr(read, name))
        assert getattr(in_memory, name).dtype == getattr(read, name).dtype
    for name in ("kind", "bit_depth", "read_noise_dn", "full_well_e", "name", "surround"):
        assert getattr(in_memory, name) == getattr(read, name)


def test_truth_is_beside_the_captures_and_not_in_them(path: Path) -> None:
    truth = json.loads(path.with_name("camera.truth.json").read_text())
    assert list(truth) == [
        *("format", "format_version", "effects", "noise", "log_likelihood_gain", "seed", "session", "captures")
    ]
    assert truth["format"] == "sci-captures-truth" and truth["captures"] == "camera.h5" and truth["seed"] == 7
    assert {effect["name"]: effect["parameters"] for effect in truth["effects"]} == HIDDEN
    assert [effect["stage"] for effect in truth["effects"]] == ["relay", "sensor", "sensor"]
    assert truth["effects"][1]["map"]["std"] == pytest.approx(0.02) and "map" not in truth["effects"][0]
    assert truth["noise"] == {"full_well_e": 10000.0, "read_noise_dn": 2.3}
    assert truth["session"]["size"] == [17, 24]
    with h5py.File(path) as file:
        assert file.attrs["read_noise_dn"] == 0.8  # the datasheet's, not the camera's
        assert file.attrs["full_well_e"] == 10000
        assert set(file.attrs) == {*STATED, "read_noise_dn", "full_well_e"}
        assert not any(data.attrs for data in file.values())
    content = path.read_bytes()
    assert not any(re.search(name.encode(), content) for name in ("mask_shift", "prnu", "truth"))


RECORDED = {
    "none": "141f391b9a32b64c",
    "mask_shift+black_level+column_noise": "085c6b672845fe34",
    "mask_astigmatism+image_lag+s_shaped_response": "9f42b91fd6697bf5",
    "mask_rotation+optical_blur+prnu+row_noise": "30fcd1ee19b1a4f8",
}
"""SHA-256 of all datasets, recorded with the version before the virtual camera became one class."""


@pytest.mark.parametrize("effects", RECORDED)
def test_a_seed_gives_the_captures_that_it_always_gave(effects: str) -> None:
    few = {"static": 2, "dynamic": 2, "unknown": 1}
    session = Session(size=(24, 20), frames=4, dark_exposures=(1.0, 2.0), surround="dark", **few)
    captures = VirtualCamera(session, effects.split("+") if "+" in effects else effects, number=3).capture(seed=2)
    content = hashlib.sha256(repr(captures.kind).encode())
    for name in ("patterns", "sequence", "measurement", "scene", "aperture", "exposure"):
        content.update(getattr(captures, name).tobytes())
    assert content.hexdigest()[:16] == RECORDED[effects]


def test_a_datasheet_can_be_withheld(tmp_path: Path) -> None:
    session = Session(size=(16, 16), frames=2, datasheet=False)
    VirtualCamera(session).write(tmp_path / "a.hdf5")
    with h5py.File(tmp_path / "a.hdf5") as file:
        assert set(file.attrs) == STATED
        assert file["measurement"].dtype == np.uint8
    assert json.loads((tmp_path / "a.truth.json").read_text())["effects"] == []
    assert VirtualCamera(session).capture().full_well_e is None


def test_every_effect_can_be_stated_as_truth() -> None:
    few = {"dark": 0, "flat": 0, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 2}
    session = Session(size=(16, 16), frames=2, oversampling=1, surround="dark", **few)
    simulation = VirtualCamera(session, list(EFFECTS)).simulate(seed=1)
    assert list(simulation.effects) == list(EFFECTS)  # in the order of light
    assert len(json.loads(json.dumps(simulation.truth().as_json()))["effects"]) == len(EFFECTS)


def test_the_truth_says_what_each_effect_adds_to_the_others() -> None:
    session = Session(size=(24, 24), frames=4)
    dim = {"gain": {"factor": 0.5}, "saturation": {"level": 0.9}, "prnu": {"std": 0.03}}
    truth = VirtualCamera(session, dim).simulate(seed=2).truth()
    gains = {effect.name: effect.log_likelihood_gain for effect in truth.effects}
    assert gains["saturation"] == pytest.approx(0, abs=1)  # nothing is bright enough
    assert gains["gain"] is not None and gains["gain"] > 1000
    assert gains["prnu"] is not None and 100 < gains["prnu"] < truth.log_likelihood_gain
    alone = VirtualCamera(session, {"gain": {"factor": 0.5}}).simulate(seed=2).truth()
    assert alone.effects[0].log_likelihood_gain == pytest.approx(alone.log_likelihood_gain)


@pytest.mark.parametrize("name", ["captures.txt", "captures", "folder.h5"])
def test_wrong_names(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder.h5").mkdir()
    with pytest.raises(BadInput, match=r"ends in \.h5"):
        VirtualCamera(Session(size=(16, 16), frames=2)).write(tmp_path / name)
    assert [file.name for file in tmp_path.iterdir()] == ["folder.h5"]
