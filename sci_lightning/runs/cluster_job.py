"""The job of a cluster in which this process runs: Slurm's, or a task of Ray."""

from __future__ import annotations

import os
import socket
import sys

from sci_lightning.files.json_file import JsonObject, says

ROW_RESTARTS = "SCI_LIGHTNING_ROW_RESTARTS"
"""Variable that says how often a row of a sweep was started again: Ray does not tell its tasks."""


class ClusterJob(JsonObject):
    """Where a run of a cluster was computed."""

    host: str = says("name of the machine, the first one of several")
    id: str = says("of the job, as the scheduler numbers it")
    restarts: int = says("how often the scheduler started the job again: after a requeue, a time limit, a lost worker")


def job_of_this_process() -> ClusterJob | None:
    """Return the job that this process belongs to, None outside of Slurm and Ray."""
    number = _id()
    return None if number is None else ClusterJob(host=socket.gethostname(), id=number, restarts=restarts_of_job())


def restarts_of_job() -> int:
    """Return how often the scheduler has started this process's job again."""
    return int(os.environ.get("SLURM_RESTART_COUNT") or os.environ.get(ROW_RESTARTS) or 0)


def _id() -> str | None:
    if array := os.environ.get("SLURM_ARRAY_JOB_ID"):
        return f"{array}_{os.environ['SLURM_ARRAY_TASK_ID']}"
    ray = sys.modules.get("ray")
    task = ray.get_runtime_context().get_task_id() if ray is not None and ray.is_initialized() else None
    return task[:8] if task else os.environ.get("SLURM_JOB_ID")
