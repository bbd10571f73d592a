"""``python -m tests.cluster.row_overhead OUT.json [ROWS]``: what a row costs in Slurm and in Ray beside its own work.

Both cores should be idle. The row is a short training and its test; how long it takes by itself is measured in
one process that has imported everything. Where Ray or Slurm is missing, the program says so and measures nothing.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tests.cluster.one_node_slurm import OneNodeSlurm, missing
from tests.conftest import ROOT
from tests.measurements_file import MeasurementsFile

CORES = 2
WORDS = [
    *("-m", "experiment=sweep", "scale=smoke", "decoder=e2e_cnn", "encoder=rbw_osr", "data.scenes_count=1"),
    *("trainer.accelerator=cpu", "metrics.qscore=null", "logger=none", "callbacks.pictures=null"),
]
SLURM = ["hydra/launcher=slurm", "hydra.launcher.cpus_per_task=1", "hydra.launcher.partition=cpu"]


def seconds(folder: Path, rows: int, more: Sequence[str], environment: Mapping[str, str]) -> float:
    """Return how long a sweep of so many rows takes, from the command line to its end."""
    begun = time.monotonic()
    words = [*WORDS, f"seed=range({rows})", f"out={folder}", *more]
    done = subprocess.run(
        [sys.executable, "-m", "sci_lightning.train", *words],
        env={**environment, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        cwd=folder.parent,
        capture_output=True,
        text=True,
    )
    if f"{rows} rows: {rows} done" not in done.stdout:
        sys.exit(done.stdout + done.stderr)
    return time.monotonic() - begun


def of_importing() -> float:
    """Return the median seconds of a process that imports torch and Lightning and does nothing, beside another one."""
    times = []
    for _ in range(5):
        begun = time.monotonic()
        both = [subprocess.Popen([sys.executable, "-c", "import torch, lightning"]) for _ in range(CORES)]
        if any(process.wait() for process in both):
            sys.exit("torch cannot be imported")
        times.append(time.monotonic() - begun)
    return statistics.median(times)


def main(out: Path, count: int) -> None:
    if reason := missing() or ("" if find_spec("ray") else "Ray is not installed"):
        sys.exit(reason)
    file = MeasurementsFile(
        out,
        machine="two cores, a Slurm of one node, a Ray of one node",
        scale=f"{count} rows of scale=smoke",
        seeds=f"0 to {count - 1}",
        command=f"python -m tests.cluster.row_overhead docs/results/{out.name} {count}",
    )
    with tempfile.TemporaryDirectory(prefix="slurm") as place:
        here = dict(os.environ)
        alone = (seconds(Path(place, "ten"), 10, [], here) - seconds(Path(place, "two"), 2, [], here)) / 8
        importing = of_importing()
        with OneNodeSlurm(Path(place, "slurm")) as slurm:
            took = {"Slurm": seconds(Path(place, "in_slurm"), count, SLURM, slurm.environment)}
        took["Ray"] = seconds(Path(place, "in_ray"), count, ["hydra/launcher=ray"], here)
    rows: list[dict[str, Any]] = [
        {
            "launcher": name,
            "seconds": total,
            "alone": alone,
            "importing": importing,
            "overhead": CORES * total / count - alone - importing,
        }
        for name, total in took.items()
    ]
    columns = [
        ("launcher", "launcher", None),
        ("seconds", f"{count} rows on {CORES} cores (s)", 0),
        ("alone", "a row by itself (s)", 2),
        ("importing", "importing torch and Lightning (s)", 2),
        ("overhead", "more than both, a row and core (s)", 2),
    ]
    file.write(columns, rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 200)
