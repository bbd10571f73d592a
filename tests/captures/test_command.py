"""``python -m sci_lightning.captures``."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest

from sci_lightning.captures import write_captures
from sci_lightning.cli.commands import captures as command_line
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.own_grid_camera import captures, homography


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    """Runs the command in this process, beside captures.h5 of a virtual camera; returns what it printed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)
    monkeypatch.setenv("COLUMNS", "120")
    VirtualCamera(Session(size=(16, 20), frames=4, unknown=1)).write(tmp_path / "captures.h5", seed=1)

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["captures", *words])
        command_line.main()
        return capsys.readouterr().out

    return run


def test_in_a_process_of_its_own(command, tmp_path):
    VirtualCamera(Session(size=(16, 20), frames=4)).write(tmp_path / "captures.h5", seed=1)
    done = command("captures", "info", "captures.h5")
    assert done.returncode == 0, done.stderr
    (sheet,) = (tmp_path / "outputs" / "captures").glob("*/contact_sheet.png")
    assert str(sheet.relative_to(tmp_path)) in done.stdout and sheet.stat().st_size > 10_000
    done = command("captures", "info", "none.h5")
    assert (done.returncode, done.stdout) == (2, "") and re.fullmatch("error: none.h5: .*captures=.*\n", done.stderr)


def test_info(here, tmp_path):
    printed = here("info", "captures.h5", "out=sheets")
    assert (tmp_path / "sheets" / "contact_sheet.png").is_file()
    lines = {line.split()[1]: line.split("│")[2:-1] for line in printed.splitlines() if line.startswith("│")}
    assert [lines["dark"][0].strip(), lines["dark"][-1].strip()] == ["4", "4"]
    assert [lines["unknown"][0].strip(), lines["unknown"][-1].strip()] == ["1", "0"]
    for fact in (
        "N = 31 captures, H x W = 16 x 20, T = 4 slots, P = 6 patterns",
        "8 bits",
        "read noise 0.8 DN",
        "10000",
    ):
        assert fact in printed
    assert "labelled" not in printed
    here("info", "captures=captures.h5", "out=deep/a.png")
    assert (tmp_path / "deep" / "a.png").is_file()


def test_info_names_wrong_labels(here, tmp_path):
    import h5py

    with h5py.File(tmp_path / "captures.h5", "a") as file:
        file["kind"][1] = "static"
    printed = here("info", "captures.h5", "out=a.png")
    assert re.search("capture 1 is labelled static, .*dark", printed)


def test_pack(here, tmp_path):
    (tmp_path / "LAB").mkdir()
    np.save(tmp_path / "LAB" / "masks.npy", np.full((4, 6, 7), 0.25))
    np.save(tmp_path / "LAB" / "grey.npy", np.full((2, 6, 7), 9, np.uint8))
    text = "{bit_depth: 8, patterns: masks.npy, captures: [{measurement: grey.npy, scene: 0.5}]}"
    (tmp_path / "LAB" / "captures.yaml").write_text(text)
    printed = here("pack", "LAB", "out=lab.h5")
    assert "N = 2 captures" in printed and "not stated" in printed and "lab.h5" in printed
    assert "flat" in here("info", "lab.h5", "out=a.png")


def test_register(here, tmp_path):
    matrix = homography((1.25, 1.25), 1.0, (40, 44), (48, 48))
    whole = captures(matrix, size=(40, 44), mirrors=(48, 48), sensor_to_modulator=None)
    write_captures(tmp_path / "own.h5", whole.take(range(8, 12)))
    printed = here("register", "own.h5", "pitch=[1.2,1.2]")
    assert re.search(r"48 x 48 mirrors of 1\.25\d? x 1\.25\d? .* 100 % .*residual 0\.", printed)
    assert "sci_lightning.diagnose captures=own.h5" in printed
    assert "mirrors" in here("info", "own.h5", "out=a.png")
    with pytest.raises(SystemExit):
        here("register", "own.h5")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["register"], "give captures=.."),
        (["register", "none.h5"], "none.h5: no such file"),
        (["register", "captures.h5", "pitch=2"], "pitch=2: expected two positive numbers [ACROSS,DOWN]"),
        ([], "no such command; choose plan, pack, register or info"),
        (["show"], "show: no such command; choose plan, pack, register or info"),
        (["info"], "give captures=.."),
        (["info", "a.h5", "b.h5"], "b.h5: expected key=value"),
        (["info", "captures=captures.h5", "out="], "out=: expected the path of a file or a folder"),
        (["info", "captures.h5", "--fast"], "--fast: no such option"),
        (["info", "captures.truth.json"], "captures.truth.json: not an HDF5 file, expected a captures file"),
        (["pack"], "give folder=.."),
        (["pack", "LAB", "out=lab.h5"], "LAB: no such file or folder"),
        (["pack", "folder=LAB", "out=lab.mat"], "LAB: no such file or folder"),
    ],
)
def test_bad_input_is_one_line(here, capsys, words, message):
    with pytest.raises(SystemExit) as caught:
        here(*words)
    (line,) = capsys.readouterr().err.splitlines()
    assert caught.value.code == 2 and line.startswith("error: ") and message in line


def test_traceback_on_request(here, monkeypatch):
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    with pytest.raises(ValueError, match="no such file"):
        here("info", "none.h5")


@pytest.mark.parametrize("words", [[], ["pack"], ["info"], ["register"]])
def test_help(here, capsys, words):
    printed = here(*words, "--help")
    assert ("perspective" if words == ["register"] else "out=") in printed
    assert ("pattern_levels" in printed) == (words == ["pack"])
