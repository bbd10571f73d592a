"""Random faults in sweeps in a real Slurm: ``python -m tests.cluster.random_faults OUT.json FAULTS [SEED]``.

Sweeps of four rows run one after the other until so many faults were injected. A sweep whose launcher was killed, or
that a fault left unfinished, is started again by the same line. At the end of each sweep every row must have ended
once, with the weights that it has without faults.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from tests.cluster.one_node_slurm import OneNodeSlurm, missing
from tests.cluster.paced_rows import SLURM, STEPS, SWEEP, noted, paced, process_of, same_weights, weights
from tests.conftest import ROOT
from tests.measurements_file import MeasurementsFile

SEEDS = range(4)
FAULTS = {
    "requeue": "`scontrol requeue` of a row",
    "time": "the signal before the time limit",
    "cancel": "`scancel` of a row",
    "kill": "`kill -9` of a row's process",
    "controller": "the controller stopped for seconds",
    "launcher": "`kill -9` of the sweep's process",
}


def start(slurm: OneNodeSlurm, folder: Path, seconds: float) -> subprocess.Popen[bytes]:
    """Start a sweep, or start it again."""
    seeds = f"seed={','.join(map(str, SEEDS))}"
    words = [*SWEEP, "callbacks.last.every_n_steps=1", seeds, paced(seconds), *SLURM, "hydra.launcher.name=faults"]
    with (folder / "printed.txt").open("ab") as printed:
        return subprocess.Popen(
            [sys.executable, "-m", "sci_lightning.train", *words],
            cwd=folder,
            env={**slurm.environment, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
            stdout=printed,
            stderr=printed,
        )


def inject(kind: str, slurm: OneNodeSlurm, sweep: subprocess.Popen[bytes], folder: Path, chance: random.Random) -> bool:
    """Inject a fault; return False if there is nothing that it could happen to."""
    running = sorted(job for job, state in slurm.jobs().items() if state == "RUNNING")
    if kind == "launcher":
        sweep.kill()
        sweep.wait()
    elif kind == "controller":
        slurm.stop("slurmctld")
        time.sleep(chance.uniform(1, 5))
        slurm.start("slurmctld")
    elif not running:
        return False
    elif kind == "kill":
        begun = [seed for seed in SEEDS if noted(folder, seed) and "end" not in noted(folder, seed)]
        try:
            os.kill(process_of(folder, chance.choice(begun)), signal.SIGKILL)
        except (IndexError, ProcessLookupError):  # no row has begun, or this one waits in the queue
            return False
    elif kind == "time":
        slurm("scancel", "--signal=USR2", chance.choice(running))
    else:
        slurm(*{"requeue": ("scontrol", "requeue"), "cancel": ("scancel",)}[kind], chance.choice(running))
    return True


def run_sweep(slurm: OneNodeSlurm, folder: Path, chance: random.Random, most: int) -> tuple[Counter[str], int]:
    """Run a sweep to its end, with at most so many faults; return these by kind, and how often it was started."""
    faults: Counter[str] = Counter()
    starts, sweep = 1, start(slurm, folder, 0.4)
    while True:
        time.sleep(chance.uniform(1, 8))
        if sweep.poll() is not None:
            if sweep.returncode == 0:
                return faults, starts
            starts, sweep = starts + 1, start(slurm, folder, 0.4)
        elif faults.total() < most:
            kind = chance.choice(list(FAULTS))
            faults[kind] += inject(kind, slurm, sweep, folder, chance)


def judge(folder: Path, undisturbed: Mapping[int, dict[str, torch.Tensor]]) -> Counter[str]:
    """Count the rows of a sweep that were lost, made twice or came out otherwise, and the steps made again."""
    counted: Counter[str] = Counter()
    for seed in SEEDS:
        made = noted(folder, seed)
        counted["lost"] += "end" not in made or set(STEPS) != set(made) - {"end"}
        counted["twice"] += made.count("end") > 1
        counted["other_weights"] += not same_weights(weights(folder, seed), undisturbed[seed])
        counted["again"] += len(made) - made.count("end") - len(STEPS)
    return counted


def main(out: Path, wanted: int, seed: int) -> None:
    if reason := missing():
        sys.exit(reason)
    chance = random.Random(seed)
    faults: Counter[str] = Counter()
    counted: Counter[str] = Counter()
    sweeps = starts = 0
    file = MeasurementsFile(
        out,
        machine="two cores, a Slurm of one node, other work on both",
        scale=f"sweeps of {len(SEEDS)} rows of scale=smoke, {len(STEPS)} steps of at least 0.4 s",
        seeds=str(seed),
        command=f"python -m tests.cluster.random_faults docs/results/{out.name} {wanted} {seed}",
    )
    with tempfile.TemporaryDirectory(prefix="slurm") as place, OneNodeSlurm(Path(place, "slurm")) as slurm:
        quiet = Path(place, "quiet")
        quiet.mkdir()
        if start(slurm, quiet, 0.0).wait():
            sys.exit((quiet / "printed.txt").read_text())
        undisturbed = {number: weights(quiet, number) for number in SEEDS}
        while faults.total() < wanted:
            folder = Path(place, f"sweep{sweeps}")
            folder.mkdir()
            injected, again = run_sweep(slurm, folder, chance, min(8, wanted - faults.total()))
            sweeps, starts, faults = sweeps + 1, starts + again, faults + injected
            counted.update(judge(folder, undisturbed))
            print(sweeps, dict(faults), dict(counted), flush=True)
            rows: list[dict[str, Any]] = [{"fault": text, "count": faults[kind]} for kind, text in FAULTS.items()]
            file.write(
                [("fault", "fault", None), ("count", "injected", 0)],
                rows,
                [
                    f"{faults.total()} faults in {sweeps} sweeps of {len(SEEDS)} rows, which took {starts} starts: "
                    f"{counted['lost']} rows lost, {counted['twice']} finished twice, {counted['other_weights']} with "
                    f"other weights than without faults, {counted['again']} steps made twice."
                ],
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 0)
