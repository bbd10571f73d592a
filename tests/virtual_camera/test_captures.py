"""The captures file is as documented, and the truth is not in it."""

from __future__ import annotations

import json
import re

import h5py
import numpy as np
import pytest

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import EFFECTS, Session, capture_session, write_captures

SESSION = Session(size=(17, 24), frames=4, bit_depth=10, unknown=1, dark_exposures=(1.0, 2.0))
TOLD = {"mask_shift": {"dx": 0.61, "dy": -0.35}, "read_noise": {"std": 2.3}, "prnu": {"std": 0.02}}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("captures") / "camera.h5"
    write_captures(path, capture_session(SESSION, TOLD, 7))
    return path


def test_format(path):
    count, slots, size = sum(SESSION.counts.values()), 4, (17, 24)
    with h5py.File(path) as file:
        assert file.attrs["format"] == "sci-captures" and file.attrs["format_version"] == 1
        assert file.attrs["bit_depth"] == 10 and file.attrs["name"] == "virtual camera"
        found = {name: (data.dtype, data.shape) for name, data in file.items() if name != "kind"}
        assert found == {
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
        assert file["patterns"][:].min() >= 0 and file["patterns"][:].max() <= 1
        assert (file["patterns"][slots] == 0).all() and (file["patterns"][slots + 1] == 1).all()
        assert file["measurement"][:].max() < 1024
        unknown = np.isnan(file["scene"][:]).all((1, 2, 3))
        assert (unknown == (kind == "unknown")).all()
        nominal = (file["patterns"][:][file["sequence"][:]] * file["scene"][:]).sum(1) * file["aperture"][:][
            :, None, None
        ]
        error = file["measurement"][:] / 1023 - np.clip(nominal, 0, 1)
        assert np.nanmean(np.abs(error)) < 0.06


def test_truth_is_beside_the_captures_and_not_in_them(path):
    truth = json.loads(path.with_name("camera.truth.json").read_text())
    assert truth["format"] == "sci-captures-truth" and truth["captures"] == "camera.h5" and truth["seed"] == 7
    assert {each["name"]: each["parameters"] for each in truth["effects"]} == TOLD
    assert [each["stage"] for each in truth["effects"]] == ["relay", "sensor", "sensor"]
    assert truth["effects"][1]["map"]["std"] == pytest.approx(0.02)
    assert truth["noise"] == {"full_well_e": 10000.0, "read_noise_dn": 2.3}
    assert truth["session"]["size"] == [17, 24]
    with h5py.File(path) as file:
        assert file.attrs["read_noise_dn"] == 0.8  # the datasheet's, not the camera's
        assert file.attrs["full_well_e"] == 10000
        assert set(file.attrs) == {"format", "format_version", "bit_depth", "name", "read_noise_dn", "full_well_e"}
        assert not any(data.attrs for data in file.values())
    content = path.read_bytes()
    assert not any(re.search(name.encode(), content) for name in ("mask_shift", "prnu", "truth"))


def test_a_datasheet_can_be_withheld(tmp_path):
    session = Session(size=(16, 16), frames=2, datasheet=False)
    write_captures(tmp_path / "a.hdf5", capture_session(session, None, 0))
    with h5py.File(tmp_path / "a.hdf5") as file:
        assert set(file.attrs) == {"format", "format_version", "bit_depth", "name"}
        assert file["measurement"].dtype == np.uint8
    assert json.loads((tmp_path / "a.truth.json").read_text())["effects"] == []


def test_every_effect_can_be_told_as_truth(tmp_path):
    session = Session(size=(16, 16), frames=4)
    captures = capture_session(session, list(EFFECTS), 1)
    assert list(captures.effects) == list(EFFECTS)  # in the order of light
    assert len(json.loads(json.dumps(captures.truth()))["effects"]) == len(EFFECTS)


def test_the_truth_says_what_each_effect_adds_to_the_others():
    session = Session(size=(24, 24), frames=4)
    dim = {"gain": {"factor": 0.5}, "saturation": {"level": 0.9}, "prnu": {"std": 0.03}}
    truth = capture_session(session, dim, 2).truth()
    gains = {each["name"]: each["log_likelihood_gain"] for each in truth["effects"]}
    assert gains["saturation"] == pytest.approx(0, abs=1)  # nothing is bright enough
    assert gains["gain"] > 1000 and 100 < gains["prnu"] < truth["log_likelihood_gain"]
    alone = capture_session(session, {"gain": {"factor": 0.5}}, 2).truth()
    assert alone["effects"][0]["log_likelihood_gain"] == pytest.approx(alone["log_likelihood_gain"])


@pytest.mark.parametrize("name", ["captures.txt", "captures", "folder.h5"])
def test_wrong_names(tmp_path, name):
    (tmp_path / "folder.h5").mkdir()
    with pytest.raises(BadInput, match=r"ends in \.h5"):
        write_captures(tmp_path / name, capture_session(Session(size=(16, 16), frames=2), None, 0))
    assert [file.name for file in tmp_path.iterdir()] == ["folder.h5"]
