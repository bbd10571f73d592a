"""The launcher of Slurm without Slurm: what it does about jobs that are lost, and about a Slurm that refuses them."""

from __future__ import annotations

import stat
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from hydra.core.utils import JobReturn, JobStatus

pytest.importorskip("hydra_plugins.hydra_submitit_launcher", reason="pip install sci-lightning[launchers]")


class FakeJob:
    """A job as submitit's launcher sees it: its result, or the error that submitit raises for it.

    Args:
        folder: of its output.
        outcome: of ``results``.
        state: in the end, as sacct calls it.
        wrote: whether it could write.
    """

    def __init__(self, folder: Path, outcome: JobReturn | Exception, state: str, wrote: bool = True) -> None:
        self.paths = type("Paths", (), {"stdout": folder / f"{id(self)}.out"})
        self.outcome, self.state, self.waited = outcome, state, False
        if wrote:
            self.paths.stdout.touch()

    def wait(self) -> list[JobReturn]:
        self.waited = True
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return [self.outcome]


@pytest.fixture
def launched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Sequence[JobReturn]]:
    """``launched(job, ..)``: what the launcher returns of a sweep with these jobs; squeue has none of it."""
    import submitit
    from omegaconf import OmegaConf

    from hydra_plugins.sci_lightning_slurm import SlurmLauncher

    monkeypatch.setattr(submitit.SlurmJob, "results", FakeJob.wait)
    squeue = tmp_path / "bin" / "squeue"
    squeue.parent.mkdir()
    squeue.write_text("#!/bin/sh\n")
    squeue.chmod(squeue.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{squeue.parent}:/usr/bin:/bin")

    def launch(*jobs: FakeJob) -> Sequence[JobReturn]:
        class Executor:
            def update_parameters(self, **given: Any) -> None:
                assert given["name"].startswith("train-")

            def map_array(self, *_: Any) -> list[Any]:
                monkeypatch.setattr(FakeJob, "results", submitit.SlurmJob.results, raising=False)
                return list(jobs)

        monkeypatch.setattr(submitit, "AutoExecutor", lambda **_: Executor())
        launcher = SlurmLauncher(
            submitit_folder=str(tmp_path / "jobs"), name="train", additional_parameters={}, max_num_timeout=3
        )
        config = OmegaConf.create({"hydra": {"sweep": {"dir": str(tmp_path)}}})
        launcher.setup(config=config, hydra_context=None, task_function=None)
        return launcher.launch([["a=1"], ["a=2"], ["a=3"]][: len(jobs)], 0)

    return launch


def test_a_lost_job_does_not_end_the_others(launched: Callable[..., Sequence[JobReturn]], tmp_path: Path) -> None:
    from submitit.core.utils import FailedJobError, UncompletedJobError

    done = JobReturn(status=JobStatus.COMPLETED, _return_value=30.0)
    cancelled = FakeJob(tmp_path, UncompletedJobError("no output"), "CANCELLED", wrote=False)
    killed = FakeJob(tmp_path, FailedJobError("killed"), "FAILED")
    last = FakeJob(tmp_path, done, "COMPLETED")
    results = launched(cancelled, killed, last)
    assert [result.return_value for result in results] == [None, None, 30.0] and last.waited


def test_a_folder_that_no_job_can_see(launched: Callable[..., Sequence[JobReturn]], tmp_path: Path) -> None:
    from submitit.core.utils import UncompletedJobError

    from sci_lightning.errors import BadInput

    jobs = [FakeJob(tmp_path, UncompletedJobError("no output"), "FAILED", wrote=False) for _ in range(2)]
    with pytest.raises(BadInput, match="no job could write there"):
        launched(*jobs)


def test_without_slurm_one_line(refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    words = ["-m", "hydra/launcher=slurm", "encoder=rbw_sr,lsw_sr", "out=sweep"]
    assert "hydra/launcher=slurm" in refused("train", *words)
