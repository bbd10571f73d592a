"""What clusters do to jobs, done to a sweep in a real Slurm: every row ends once, with the weights of a quiet one."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import torch

from tests.cluster.one_node_slurm import OneNodeSlurm, missing, wait_until
from tests.cluster.paced_rows import SLURM, STEPS, SWEEP, noted, paced, process_of, row, same_weights, weights
from tests.conftest import ROOT

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def slurm() -> Iterator[OneNodeSlurm]:
    """A Slurm of one node that says it has two processors."""
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher", reason="pip install sci-lightning[launchers]")
    if reason := missing():
        pytest.skip(reason)
    with tempfile.TemporaryDirectory(prefix="slurm") as folder, OneNodeSlurm(Path(folder)) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def uninterrupted(slurm: OneNodeSlurm, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, torch.Tensor]]:
    """The weights of two rows that nothing happened to."""
    folder = tmp_path_factory.mktemp("uninterrupted")
    assert "2 rows: 2 done" in Sweep(slurm, folder, 0.0).end()
    assert [noted(folder, seed) for seed in (0, 1)] == [[*STEPS, "end"]] * 2
    return [weights(folder, seed) for seed in (0, 1)]


class Sweep:
    """A sweep of two rows, seeds 0 and 1, that runs until :meth:`end`.

    Args:
        slurm: in which it runs.
        folder: the current one.
        seconds: at least, of a step.
        more: words of its command line.
    """

    def __init__(self, slurm: OneNodeSlurm, folder: Path, seconds: float, more: Sequence[str] = ()) -> None:
        self.folder = folder
        words = [*SWEEP, "seed=0,1", paced(seconds), *SLURM, *more]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sci_lightning.train", *words],
            cwd=folder,
            env={**slurm.environment, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def until_step(self, seed: int, step: int) -> None:
        """Wait until a row has finished a step."""
        wait_until(lambda: str(step) in noted(self.folder, seed), 180, f"row {seed} does not come to step {step}")

    def end(self, status: int = 0) -> str:
        """Wait for the end; return what was printed."""
        printed, _ = self.process.communicate(timeout=600)
        assert self.process.returncode == status, printed
        return printed


def check(folder: Path, uninterrupted: Sequence[dict[str, torch.Tensor]], repeated: int = 0) -> None:
    """Check that both rows ended once and as without a fault.

    Args:
        folder: of the sweep.
        uninterrupted: weights of such rows.
        repeated: steps that one row may have made twice: those after its last checkpoint.
    """
    for seed in (0, 1):
        made = noted(folder, seed)
        assert made.count("end") == 1 and sorted(set(made) - {"end"}, key=int) == STEPS, made
        assert len(made) - len(STEPS) - 1 <= repeated, made
        assert same_weights(weights(folder, seed), uninterrupted[seed])


def job_of(folder: Path, seed: int) -> dict[str, object]:
    return dict(json.loads((row(folder, seed) / "metrics.json").read_text())["job"])


def running(slurm: OneNodeSlurm, number: int) -> str:
    """Return the job of the row with this number, of the sweep that is running."""
    return next(job for job, state in slurm.jobs().items() if state == "RUNNING" and job.endswith(f"_{number}"))


def test_requeue(slurm: OneNodeSlurm, uninterrupted: list[dict[str, torch.Tensor]], tmp_path: Path) -> None:
    sweep = Sweep(slurm, tmp_path, 0.5)
    sweep.until_step(0, 5)
    slurm("scontrol", "requeue", running(slurm, 0))
    printed = sweep.end()
    assert "2 rows: 2 done" in printed and "restarts" in printed
    check(tmp_path, uninterrupted)
    assert [job_of(tmp_path, seed)["restarts"] for seed in (0, 1)] == [1, 0]


def test_time_limit(slurm: OneNodeSlurm, uninterrupted: list[dict[str, torch.Tensor]], tmp_path: Path) -> None:
    sweep = Sweep(slurm, tmp_path, 1.5, ["hydra.launcher.timeout_min=1", "hydra.launcher.signal_delay_s=25"])
    assert "2 rows: 2 done" in sweep.end()
    check(tmp_path, uninterrupted)
    assert all(int(str(job_of(tmp_path, seed)["restarts"])) > 0 for seed in (0, 1))


def test_too_many_time_limits(slurm: OneNodeSlurm, tmp_path: Path) -> None:
    limits = ["hydra.launcher.timeout_min=1", "hydra.launcher.signal_delay_s=25", "hydra.launcher.max_num_timeout=0"]
    printed = Sweep(slurm, tmp_path, 5.0, limits).end(status=1)
    assert "2 rows: 2 failed" in printed and "max_num_timeout" in printed


def test_cancel(slurm: OneNodeSlurm, uninterrupted: list[dict[str, torch.Tensor]], tmp_path: Path) -> None:
    sweep = Sweep(slurm, tmp_path, 0.5)
    sweep.until_step(0, 5)
    slurm("scancel", running(slurm, 0))
    assert "1 done, 1 unfinished" in sweep.end(status=1)
    assert "2 rows: 2 done" in Sweep(slurm, tmp_path, 0.0).end()
    check(tmp_path, uninterrupted)


def test_a_worker_is_killed(slurm: OneNodeSlurm, uninterrupted: list[dict[str, torch.Tensor]], tmp_path: Path) -> None:
    every_step = ["callbacks.last.every_n_steps=1"]
    sweep = Sweep(slurm, tmp_path, 0.5, every_step)
    sweep.until_step(1, 5)
    os.kill(process_of(tmp_path, 1), signal.SIGKILL)
    assert "1 done, 1 unfinished" in sweep.end(status=1)
    assert "2 rows: 2 done" in Sweep(slurm, tmp_path, 0.0, every_step).end()
    check(tmp_path, uninterrupted, repeated=1)


def test_the_controller_stops_for_a_while(
    slurm: OneNodeSlurm, uninterrupted: list[dict[str, torch.Tensor]], tmp_path: Path
) -> None:
    sweep = Sweep(slurm, tmp_path, 0.5)
    sweep.until_step(0, 3)
    slurm.stop("slurmctld")
    time.sleep(8)
    slurm.start("slurmctld")
    assert "2 rows: 2 done" in sweep.end()
    check(tmp_path, uninterrupted)


def test_a_full_disk_in_one_row(
    slurm: OneNodeSlurm, uninterrupted: list[dict[str, torch.Tensor]], tmp_path: Path
) -> None:
    full = row(tmp_path, 1)
    full.mkdir(parents=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=40k", "none", str(full)], check=True)
    try:
        printed = Sweep(slurm, tmp_path, 0.0).end(status=1)
    finally:
        subprocess.run(["umount", str(full)], check=True)
    assert "1 done, 1 failed" in printed and "free some space" in printed
    assert "2 rows: 2 done" in Sweep(slurm, tmp_path, 0.0).end()
    check(tmp_path, uninterrupted)


def test_a_row_that_fails(slurm: OneNodeSlurm, uninterrupted: list[dict[str, torch.Tensor]], tmp_path: Path) -> None:
    row(tmp_path, 0).mkdir(parents=True)
    (row(tmp_path, 0) / "metrics.json").write_text("{}")
    printed = Sweep(slurm, tmp_path, 0.0).end(status=2)
    assert "1 done, 1 failed" in printed and "not the metrics of a run" in printed
    (row(tmp_path, 0) / "metrics.json").unlink()
    assert "2 rows: 2 done" in Sweep(slurm, tmp_path, 0.0).end()
    check(tmp_path, uninterrupted)


def test_the_launcher_is_killed(
    slurm: OneNodeSlurm, uninterrupted: list[dict[str, torch.Tensor]], tmp_path: Path
) -> None:
    sweep = Sweep(slurm, tmp_path, 0.7)
    sweep.until_step(0, 2)
    sweep.process.kill()
    sweep.process.communicate()
    assert "2 rows: 2 done" in Sweep(slurm, tmp_path, 0.7).end()
    check(tmp_path, uninterrupted)


def test_jobs_share_the_cases_of_a_study(slurm: OneNodeSlurm, tmp_path: Path) -> None:
    """A job that is cancelled takes no case with it but the one that it was running, and the other one runs that."""
    words = ["suites=[nothing]", "seeds=1", "cases=null", "workers=0", "out=proof", "job=range(2)", *SLURM]
    process = subprocess.Popen(
        [sys.executable, "-m", "sci_lightning.proving_ground", "-m", *words],
        cwd=tmp_path,
        env={**slurm.environment, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    cases = tmp_path / "proof" / "cases"
    wait_until(lambda: any(cases.glob("*.json")), 300, "no case ends")
    slurm("scancel", running(slurm, 0))
    printed, _ = process.communicate(timeout=600)
    assert "1 done, 1 unfinished" in printed, printed
    assert len(list(cases.glob("*.json"))) == 12 and not list((cases / "failed").glob("*.json"))
    assert (tmp_path / "proof" / "summary.json").is_file()


def test_what_slurm_refuses(slurm: OneNodeSlurm, tmp_path: Path) -> None:
    printed = Sweep(slurm, tmp_path, 0.0, ["hydra.launcher.partition=gpu"]).end(status=2)
    errors = [line for line in printed.splitlines() if line.startswith("error:")]
    assert len(errors) == 1 and "invalid partition" in errors[0] and "rows:" not in printed, printed


def test_a_folder_that_the_jobs_cannot_see(slurm: OneNodeSlurm, tmp_path: Path) -> None:
    """The sweep's own mount, which no job has, is what a local disk is to another machine."""
    words = [*SWEEP, "seed=0,1", *SLURM]
    line = f'mount -t tmpfs none {tmp_path} && cd {tmp_path} && exec {sys.executable} -m sci_lightning.train "$@"'
    done = subprocess.run(
        ["unshare", "--mount", "bash", "-c", line, "sweep", *words],
        env={**slurm.environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    errors = [line for line in done.stderr.splitlines() if line.startswith("error:")]
    assert done.returncode == 2 and len(errors) == 1 and "no job could write there" in errors[0], done.stderr
