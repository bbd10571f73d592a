"""``python -m sci_lightning.virtual_camera``."""

from __future__ import annotations

import json
import sys

import h5py
import pytest

from sci_lightning.cli import command as command_frame
from sci_lightning.cli.commands.virtual_camera import virtual_camera

SMALL = ("size=[16,20]", "frames=4", "seed=3")


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Runs the command in this process and an empty folder."""

    def run(*overrides):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["virtual_camera", *SMALL, *overrides])
        monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)
        command_frame.run("virtual_camera", virtual_camera)

    return run


def test_in_a_process_of_its_own(command, tmp_path):
    done = command("virtual_camera", *SMALL, "out=a.h5", "effects=random")
    assert done.returncode == 0, done.stderr
    assert "a.h5" in done.stdout and "a.truth.json" in done.stdout
    (effect,) = json.loads((tmp_path / "a.truth.json").read_text())["effects"]
    assert effect["name"] not in done.stdout + done.stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.h5", "a.truth.json"]


@pytest.mark.parametrize(
    ("overrides", "hidden"),
    [
        (["effects=none"], {}),
        (["effects=[mask_shift,gain]"], {"mask_shift": None, "gain": None}),
        (
            ["effects=[{name:mask_shift,dx:0.61,dy:-0.35},gain]"],
            {"mask_shift": {"dx": 0.61, "dy": -0.35}, "gain": None},
        ),
        (["effects={mask_shift:{dx:0.61}}"], {"mask_shift": {"dx": 0.61, "dy": 0.0}}),
        (["+effects.mask_shift.dx=0.61", "+effects.gain={}"], {"mask_shift": {"dx": 0.61, "dy": 0.0}, "gain": None}),
    ],
)
def test_ways_to_say_what_to_hide(here, tmp_path, overrides, hidden):
    here("out=deep/b.h5", *overrides)
    truth = json.loads((tmp_path / "deep" / "b.truth.json").read_text())["effects"]
    result = {each["name"]: each["parameters"] for each in truth}
    assert list(result) == list(hidden)
    assert all(result[name] == values for name, values in hidden.items() if values is not None)


def test_session_by_overrides(here, tmp_path):
    here("out=c.h5", "mask=binary", "bit_depth=12", "dark=0", "pattern=0", "unknown=1", "datasheet=false")
    with h5py.File(tmp_path / "c.h5") as file:
        assert file["patterns"].shape == (6, 16, 20) and file["measurement"].dtype == "uint16"
        assert "dark" not in file["kind"].asstr()[:] and "full_well_e" not in file.attrs


def test_without_out_it_writes_under_outputs(here, tmp_path):
    here()
    assert len(list((tmp_path / "outputs" / "virtual_camera").glob("*/captures.h5"))) == 1


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("effects=mask_shft", "choose random, outside, none or of"),
        ("effects=[{name:gain,factor:-1}]", "gain.factor must be a number from 0.01 to 100"),
        ("size=[8,8]", "size must be a whole number from 16"),
        ("mask=solid", "no such file; mask is structural, binary or a file of"),
        ("out=captures.mat", "ends in .h5"),
        ("sed=1", "sed"),
    ],
)
def test_bad_input_is_one_line(here, capsys, override, message):
    with pytest.raises(SystemExit) as caught:
        here("out=d.h5", override)
    assert caught.value.code == 2
    (line,) = (line for line in capsys.readouterr().err.splitlines() if line.startswith("error: "))
    assert message in line
