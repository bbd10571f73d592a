"""Sweeps of the paper's tables: killed and started again, with rows that fail, and what comes out of them."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.studies.tables.paper_figures import swept
from tests.conftest import members
from tests.end_to_end.killed_training import KILLED, steps

Command = Callable[..., subprocess.CompletedProcess[str]]

ROWS = ["experiment=table2", "scale=smoke", "decoder=e2e_cnn,metasci", "data.scenes_count=1"]
QUICK = ["trainer.accelerator=cpu", "metrics.qscore=null", "logger=none", "out=sweep"]
STEPS = ["data.clips_per_epoch=20", "callbacks.last.every_minutes=null", "callbacks.last.every_n_steps=1"]


def reached(folder: Path) -> int:
    """The step of a run's last checkpoint."""
    last = folder / "checkpoints" / "last.ckpt"
    return int(torch.load(last, weights_only=True)["global_step"]) if last.is_file() else 0


@pytest.mark.slow
def test_killed_and_started_again(command: Command, tmp_path: Path) -> None:
    words = ["-m", *ROWS, *QUICK, *STEPS, KILLED % "MetaSCI: 4"]
    assert command("train", *words).returncode == -signal.SIGKILL
    first, second = (tmp_path / "sweep" / "rbw_osr_1bit" / name / "seed0" for name in ("e2e_cnn", "metasci"))
    kept = (first / "metrics.json").stat().st_mtime_ns
    assert not (second / "metrics.json").is_file()
    step = reached(second)
    assert step == 4
    before = len(steps(tmp_path, "MetaSCI"))

    done = command("train", *words)
    assert done.returncode == 0, done.stderr
    assert "finished before, kept" in done.stdout
    assert (first / "metrics.json").stat().st_mtime_ns == kept
    assert steps(tmp_path, "E2ECNN") == list(range(10))
    assert steps(tmp_path, "MetaSCI")[before:] == list(range(step, 10))  # goes on where the checkpoint is
    assert reached(second) == 10

    for folder in (first, second):
        result = {name: json.loads((folder / name / "metrics.json").read_text()) for name in (".", "test_rbw_sr")}
        assert [each["test_encoder"] for each in result.values()] == ["rbw_osr", "rbw_sr"]
        assert result["."]["mean"] != result["test_rbw_sr"]["mean"]
    printed = command("tables", "runs=sweep", "out=tables")
    told = " ".join(printed.stdout.split())  # wrapped wherever a long folder's name puts the margin
    assert printed.returncode == 0 and "4 runs" in told, printed.stderr
    rows = [line for line in (tmp_path / "tables" / "table2.md").read_text().splitlines() if "smoke: 32 x 32" in line]
    assert len(rows) == 4


@pytest.mark.slow
def test_killed_and_started_again_in_processes_of_joblib(command: Command, tmp_path: Path) -> None:
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher", reason="pip install sci-lightning[launchers]")
    both = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2", *ROWS, *QUICK, *STEPS, KILLED % "MetaSCI: 2, E2ECNN: 3"]
    assert command("train", "-m", *both).returncode == -signal.SIGKILL
    names = {"E2ECNN": "e2e_cnn", "MetaSCI": "metasci"}
    folders = {kind: tmp_path / "sweep" / "rbw_osr_1bit" / name / "seed0" for kind, name in names.items()}
    left = {kind: (reached(folder), len(steps(tmp_path, kind))) for kind, folder in folders.items()}

    assert command("train", "-m", *both).returncode == 0
    for kind, (step, before) in left.items():
        assert step == {"E2ECNN": 3, "MetaSCI": 2}[kind]
        assert steps(tmp_path, kind)[before:] == list(range(step, 10))  # goes on where the checkpoint is
        assert (folders[kind] / "metrics.json").is_file()


@pytest.mark.slow
def test_two_rows_in_processes_of_joblib(command: Command, tmp_path: Path) -> None:
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher", reason="pip install sci-lightning[launchers]")
    row = ["experiment=sweep", "scale=smoke", "encoder=rbw_sr", "decoder=e2e_cnn", "data.scenes_count=1", *QUICK]
    done = command("train", "-m", *row, "seed=0,1", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    assert done.returncode == 0, done.stderr
    assert "2 rows: 2 done" in done.stdout
    assert len(list((tmp_path / "sweep").rglob("metrics.json"))) == 2


LAUNCHERS = {"basic": None, "joblib": "hydra_joblib_launcher", "submitit_local": "hydra_submitit_launcher"}


@pytest.mark.parametrize(
    "launcher", [one if one == "basic" else pytest.param(one, marks=pytest.mark.slow) for one in LAUNCHERS]
)
def test_rows_that_fail_are_told_at_the_end(launcher: str, command: Command, tmp_path: Path) -> None:
    if module := LAUNCHERS[launcher]:
        pytest.importorskip(f"hydra_plugins.{module}", reason="pip install sci-lightning[launchers]")
    row = ["experiment=table5", "scale=smoke", "encoder=lsw_sr", "decoder=e2e_cnn", "data.scenes_count=1", *QUICK]
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "lsw_sr_2bit").touch()
    done = command("train", "-m", *row, "encoder.mask.bits=9,1,0,2", f"hydra/launcher={launcher}")
    assert done.returncode == 2
    last = done.stderr.splitlines()[-3:]
    assert all(line.startswith("error: [") for line in last)
    for line, bits, reason in zip(last, (9, 0, 2), ("1 to 8", "1 to 8", "where a folder is needed"), strict=True):
        assert f"encoder.mask.bits={bits}" in line and reason in line
    for bits, made in ((9, False), (1, True), (0, False)):
        folder = tmp_path / "sweep" / f"lsw_sr_{bits}bit" / "e2e_cnn" / "seed0"
        assert (folder / "metrics.json").is_file() == made
        assert (folder / ".hydra").is_dir()
    assert not list((tmp_path / "sweep").glob(".rows*"))
    assert "4 rows: 1 done, 3 failed" in done.stdout


@pytest.mark.parametrize("launcher", ["basic", pytest.param("joblib", marks=pytest.mark.slow)])
def test_rows_that_do_not_exist_are_skipped(launcher: str, command: Command, tmp_path: Path) -> None:
    """A binary mask has one bit, an ideal sensor no bit depth, and E2E-CNN no ``depths``: one line each."""
    if module := LAUNCHERS[launcher]:
        pytest.importorskip(f"hydra_plugins.{module}", reason="pip install sci-lightning[launchers]")
    row = ["scale=smoke", "decoder=e2e_cnn", "data.scenes_count=1", "encoder.sensor.bit_depth=10", *QUICK]
    done = command("train", "-m", *row, "encoder=rbw_osr,rbw_sr", "encoder.mask.bits=1,2", f"hydra/launcher={launcher}")
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr
    assert "4 rows: 1 done, 3 skipped" in done.stdout and "PSNR (dB)" in done.stdout
    lines = [line for line in done.stdout.splitlines() if line.startswith("skipped: [")]
    assert ["encoder.sensor.bit_depth is no setting" in line for line in lines] == [True, True, False]
    assert "encoder=rbw_sr encoder.mask.bits=2]" in lines[2] and "a binary mask has 1 bit" in lines[2]
    assert [path.parent.name for path in (tmp_path / "sweep").rglob("metrics.json")] == ["2"]
    assert not list((tmp_path / "sweep").glob(".rows*"))


@pytest.mark.slow
def test_encoders_and_bit_depths_in_one_sweep(command: Command, tmp_path: Path) -> None:
    """The how-to page's own sweep: a row for every combination that exists, a line for every other one."""
    words = ["encoder=rbw_osr,rbw_sr,lsw_sr", "encoder.mask.bits=1,2,3,4", "scale=smoke", "decoder=e2e_cnn"]
    done = command("train", "-m", *words, "data.scenes_count=1", *QUICK)
    assert done.returncode == 0, done.stderr
    assert "12 rows: 6 done, 6 skipped" in done.stdout
    assert done.stdout.count("a binary mask has 1 bit; choose bits=1") == 6
    assert len(list((tmp_path / "sweep").glob("*/metrics.json"))) == 6


def test_rows_that_cannot_be_composed_do_not_stop_the_others(command: Command, tmp_path: Path) -> None:
    row = ["data.scenes_count=1", "scale=smoke", "decoder.channels=4", *QUICK]
    done = command("train", "-m", *row, "decoder=no_net,e2e_cnn", "encoder=rbw_sr,nothing")
    assert done.returncode == 2
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: [")]
    assert len(errors) == 3 and "decoder=no_net" in errors[0] and "nothing" in errors[2]
    assert "4 rows: 1 done, 3 failed" in done.stdout
    assert [path.parent.name for path in (tmp_path / "sweep").rglob("metrics.json")] == ["2"]
    assert {path.name for path in (tmp_path / "sweep").iterdir()} == {"2", "multirun.yaml"}


def test_a_sweep_of_which_no_row_exists(refused: Callable[..., str]) -> None:
    line = refused("train", "-m", "encoder=rbw_sr", "encoder.mask.bit=1,2", "out=sweep")
    assert "encoder.mask.bit is no setting" in line


def test_one_row_without_a_sweep(ran: Callable[..., str], tmp_path: Path) -> None:
    """Without ``-m`` a table's experiment is one row, in the folder in which the next sweep finds it."""
    for _ in range(2):
        printed = ran("train", "experiment=table5", "decoder=e2e_cnn", "scale=smoke", *QUICK)
    assert (tmp_path / "sweep" / "lsw_sr_4bit" / "e2e_cnn" / "seed0" / "metrics.json").is_file()
    assert "finished before, kept" in printed


def test_rows_with_folders_of_their_own(ran: Callable[..., str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        ran("export_mask", "-m", "ckpt_path=no.ckpt", "out=one,two")
    printed = capsys.readouterr()
    assert caught.value.code == 2 and printed.err.count("no such file") == 2
    assert "2 rows: 2 failed" in printed.out


def test_a_table_sweeps_what_the_paper_prints() -> None:
    assert (swept("table5", "encoder"), swept("table5", "bits")) == ("rsw_sr,lsw_sr", "1,2,3,4")
    for table in ("table2", "table3", "table4"):
        assert set(swept(table, "decoder").split(",")) <= set(members("decoder"))


@pytest.mark.parametrize("scale", [pytest.param("cpu", marks=pytest.mark.slow), "smoke"])
def test_reduced_networks(scale: str, configuration: Callable[..., Any]) -> None:
    for name in members("decoder"):
        full, reduced = (configuration("train", f"decoder={name}", f"scale={each}").decoder for each in ("own", scale))
        assert full.keys() == reduced.keys(), name
        assert (full != reduced) == (f"{scale}:" in (CONF / "decoder" / f"{name}.yaml").read_text()), name
