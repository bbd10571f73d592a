"""A sweep in a real Ray whose workers are killed, and a Ray that does not answer."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.cluster.one_node_slurm import wait_until
from tests.cluster.paced_rows import STEPS, SWEEP, noted, paced, process_of, row, same_weights, weights
from tests.conftest import ROOT

pytestmark = pytest.mark.slow
pytest.importorskip("hydra_plugins.hydra_ray_launcher", reason="pip install sci-lightning[ray]")


def sweep(folder: Path, seconds: float, more: Sequence[str]) -> subprocess.Popen[str]:
    folder.mkdir(exist_ok=True)
    words = [*SWEEP, "seed=0,1", "callbacks.last.every_n_steps=1", paced(seconds), *more]
    return subprocess.Popen(
        [sys.executable, "-m", "sci_lightning.train", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "RAY_worker_niceness": "0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_a_worker_is_killed(tmp_path: Path) -> None:
    """Ray starts the row again, which goes on from its last checkpoint."""
    undisturbed = sweep(tmp_path / "here", 0.0, [])
    assert undisturbed.communicate(timeout=300)[0].count("2 done") == 1
    disturbed = sweep(tmp_path / "ray", 0.5, ["hydra/launcher=ray"])
    wait_until(lambda: "5" in noted(tmp_path / "ray", 0), 300, "no step in Ray")
    os.kill(process_of(tmp_path / "ray", 0), signal.SIGKILL)
    printed, _ = disturbed.communicate(timeout=600)
    assert disturbed.returncode == 0 and "2 rows: 2 done" in printed, printed
    for seed in (0, 1):
        made = noted(tmp_path / "ray", seed)
        assert made.count("end") == 1 and set(made) == {*STEPS, "end"} and len(made) <= len(STEPS) + 2
        assert same_weights(weights(tmp_path / "ray", seed), weights(tmp_path / "here", seed))
    assert '"restarts": 1' in (row(tmp_path / "ray", 0) / "metrics.json").read_text()


def test_a_ray_that_does_not_answer(tmp_path: Path) -> None:
    away = ["hydra/launcher=ray", "hydra.launcher.ray.init.address=127.0.0.1:1"]
    printed, _ = (process := sweep(tmp_path, 0.0, away)).communicate(timeout=300)
    errors = [line for line in printed.splitlines() if line.startswith("error:")]
    assert process.returncode == 2 and len(errors) == 1 and "address=127.0.0.1:1" in errors[0], printed
