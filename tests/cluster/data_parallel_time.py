"""``python -m tests.cluster.data_parallel_time OUT.json``: steps of one process and of two, with a core for each.

Both cores should be idle. The batch is the same, and shared out.
"""

from __future__ import annotations

import itertools
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import lightning as L

from tests.conftest import ROOT
from tests.measurements_file import MeasurementsFile

WORDS = [
    *("decoder=res2former", "scale=cpu", "core_minutes=null", "batch_size=4", "workers=0", "data.clips_per_epoch=48"),
    *("data.scenes_count=1", "trainer.max_epochs=1", "trainer.accelerator=cpu", "precision=32", "logger=none"),
    *("metrics.qscore=null", "callbacks.pictures=null", "trainer=ddp"),
]
FIRST = 2
"""Steps that are not counted: memory is allocated in them."""


class StepTimes(L.Callback):
    """Notes when every step of the first process began."""

    def __init__(self, path: str) -> None:
        self.path = Path(path)

    def on_train_batch_start(self, trainer: L.Trainer, *_: Any) -> None:
        if trainer.is_global_zero:
            with self.path.open("a") as file:
                file.write(f"{time.monotonic()}\n")


def seconds(folder: Path, processes: int) -> float:
    """Return the median seconds of a step."""
    times = folder / f"{processes}.txt"
    note = f"+callbacks.times={{_target_: tests.cluster.data_parallel_time.StepTimes, path: '{times}'}}"
    words = [*WORDS, f"trainer.devices={processes}", note, f"out={folder / str(processes)}"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-m", "sci_lightning.train", *words], env=environment, cwd=folder, check=True)
    begun = [float(line) for line in times.read_text().splitlines()][FIRST:]
    return statistics.median(later - earlier for earlier, later in itertools.pairwise(begun))


def main(out: Path) -> None:
    file = MeasurementsFile(
        out,
        machine="two cores, a thread for each process",
        scale="cpu: a step of four clips of 64 x 64, shared out; the median of 9 steps",
        seeds="0",
        command=f"python -m tests.cluster.data_parallel_time docs/results/{out.name}",
    )
    with tempfile.TemporaryDirectory() as place:
        measured = {processes: seconds(Path(place), processes) for processes in (1, 2)}
    rows = [{"processes": n, "seconds": value, "speed": measured[1] / value} for n, value in measured.items()]
    file.write([("processes", "processes", 0), ("seconds", "step (s)", 2), ("speed", "times as fast", 2)], rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
