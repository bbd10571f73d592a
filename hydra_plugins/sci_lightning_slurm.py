"""Hydra's launcher ``slurm``: every row of a sweep is a job of Slurm, and one that is lost does not end the others.

It is submitit's launcher but for what happens at faults. Hydra takes launchers only from the namespace
``hydra_plugins``.
"""

from __future__ import annotations

import getpass
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any
from unittest.mock import patch

from hydra.core.utils import JobReturn, JobStatus
from omegaconf import DictConfig

with suppress(ImportError):  # without the extra `launchers` nothing is here, and hydra/launcher=slurm is refused
    from hydra_plugins.hydra_submitit_launcher.submitit_launcher import SlurmLauncher as SubmititLauncher

    class SlurmLauncher(SubmititLauncher):
        """Submits the rows as one array of jobs and waits for all of them, whatever becomes of single ones.

        The same line again, while jobs of the first one are queued or running, begins when these have ended: a row that
        they finish is kept, and no row runs twice.
        """

        def setup(self, *, config: DictConfig, **context: Any) -> None:
            """Take the sweep's configuration; its jobs are called after the command and the sweep's folder."""
            super().setup(config=config, **context)
            folder = Path(config.hydra.sweep.dir).absolute()
            self.params["name"] += f"-{sha256(str(folder).encode()).hexdigest()[:8]}"

        def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
            """Run the rows; a job that is lost returns nothing, so that its row stays unfinished.

            Raises:
                BadInput: there is no Slurm, it refused the jobs, or no job could write into the sweep's folder.
            """
            from submitit import SlurmJob
            from submitit.core.utils import FailedJobError

            from sci_lightning.errors import BadInput

            folder, name = Path(self.config.hydra.sweep.dir).absolute(), self.params["name"]
            silent: list[SlurmJob[Any]] = []
            try:
                self.params["additional_parameters"].pop("dependency", None)
                if earlier := _queued(name):
                    self.params["additional_parameters"]["dependency"] = f"afterany:{':'.join(earlier)}"
                with patch.object(SlurmJob, "results", _results_or_lost(SlurmJob.results, silent)):
                    results = super().launch(job_overrides, initial_job_idx)
            except KeyboardInterrupt:
                print(f"the jobs go on; the same line waits for them, scancel --name={name} ends them", file=sys.stderr)
                raise
            except (FailedJobError, OSError, RuntimeError) as error:  # what sbatch and squeue say
                reason = " ".join(str(error).split())
                raise BadInput(f"hydra/launcher=slurm: {reason}") from error
            if len(silent) == len(job_overrides):
                raise BadInput(f"{folder}: no job could write there; give an out= that all machines of a cluster share")
            return results

        def __call__(self, *args: Any, **kwargs: Any) -> JobReturn:
            """Run a row in its job; the result goes without the configurations, which nobody reads from there."""
            result = super().__call__(*args, **kwargs)
            result.cfg = result.hydra_cfg = None
            return result


def _queued(name: str) -> list[str]:
    """Return the numbers of this user's jobs of a name that are queued or running."""
    words = ["squeue", "--noheader", f"--name={name}", f"--user={getpass.getuser()}", "--format=%F"]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return sorted(set(done.stdout.split()))


def _results_or_lost(wait: Any, silent: list[Any]) -> Any:
    """Return submitit's ``Job.results`` with an empty result in the place of an error.

    Args:
        wait: submitit's own, which raises where a job was cancelled, killed or lost.
        silent: gets the jobs that have written nothing although nobody cancelled them.
    """
    from submitit.core.utils import FailedJobError, UncompletedJobError

    def results(job: Any) -> list[JobReturn]:
        try:
            return list(wait(job))
        except (UncompletedJobError, FailedJobError):
            if not job.paths.stdout.exists() and "CANCELLED" not in job.state:
                silent.append(job)
            return [JobReturn(status=JobStatus.COMPLETED)]

    return results
