"""Jobs of a sweep that share the cases of one study and its folder; a second sweep is kept out of it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT

SMALL = [
    *("data=synthetic", "data.scenes_count=1", "data.snapshots_per_scene=1", "size=[32,32]", "frames=4"),
    *("decoder=linear", "cameras=[alone]", "scenarios=[mismatched,known]"),
    *(f"mismatch.{name}=null" for name in ("mask_shift", "mask_rotation", "mask_blur", "sync_offset", "duty_cycle")),
]
"""Two cases of the mismatch protocol."""


@pytest.mark.parametrize("launcher", ["basic", pytest.param("joblib", marks=pytest.mark.slow)])
def test_jobs_share_a_folder(launcher: str, command: Callable[..., Any], tmp_path: Path) -> None:
    if launcher == "joblib":
        pytest.importorskip("hydra_plugins.hydra_joblib_launcher", reason="pip install sci-lightning[launchers]")
    two = ["hydra.launcher.n_jobs=2"] if launcher == "joblib" else []
    done = command("mismatch", "-m", *SMALL, "job=range(2)", f"hydra/launcher={launcher}", *two, "out=a")
    assert done.returncode == 0, done.stderr
    assert "2 rows: 2 done" in done.stdout and "mean PSNR of the scenes" in done.stdout
    folder = tmp_path / "a"
    assert {path.name for path in (folder / "cases").glob("*.json")} == {
        "alone_gain.linear.json",
        "alone_black_level.linear.json",
    }
    assert not (folder / "0").exists() and not (folder / ".lock").exists()
    kept = [json.loads(path.read_text()) for path in sorted((folder / "cases").glob("*.json"))]
    assert all("job" not in record["provenance"]["command"] for record in kept)


HOLD = """
import sys
from sci_lightning.runs.run_folder import run_folder
with run_folder(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_sweep_is_kept_out(refused: Callable[..., str], ran: Callable[..., str], tmp_path: Path) -> None:
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    sweep = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path / "a")], cwd=ROOT, **pipes)
    assert sweep.stdout and sweep.stdout.readline() == "held\n"
    assert "writing there" in refused("mismatch", "-m", *SMALL, "job=range(2)", "out=a")
    assert "mean PSNR" in ran("mismatch", *SMALL, "job=1", "out=a")  # one of its jobs is let in
    sweep.communicate("")


def test_rows_of_another_sweep_have_their_own_folders(ran: Callable[..., str], tmp_path: Path) -> None:
    ran("mismatch", "-m", *SMALL, "seed=0,1", "out=a")
    assert {path.name for path in (tmp_path / "a").glob("[01]")} == {"0", "1"}
