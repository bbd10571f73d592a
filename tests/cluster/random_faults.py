"""Random faults in sweeps in a real Slurm: ``python -m tests.cluster.random_faults OUT.json FAULTS SEED``.

Every run, of another seed, adds a column to the file. Sweeps of four rows run one after the other until so many faults
were injected. A sweep whose launcher was killed, or that a fault left unfinished, is started again by the same line. At
the end of each sweep every row must have ended once, with the weights that it has without faults.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import torch

from tests.cluster.one_node_slurm import OneNodeSlurm, missing
from tests.cluster.paced_rows import SLURM, STEPS, SWEEP, noted, paced, same_weights, weights
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

KINDS = {text: kind for kind, text in FAULTS.items()}


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
        return kill(slurm, chance.choice(running))
    elif kind == "time":
        slurm("scancel", "--signal=USR2", chance.choice(running))
    else:
        slurm(*{"requeue": ("scontrol", "requeue"), "cancel": ("scancel",)}[kind], chance.choice(running))
    return True


def kill(slurm: OneNodeSlurm, job: str) -> bool:
    """Kill the process of a row; return False if its job has none yet, or none any more."""
    number = slurm("squeue", "--noheader", f"--jobs={job}", "--format=%A").strip()
    for line in slurm("scontrol", "listpids", number).splitlines()[1:]:
        process = line.split()[0]
        with suppress(OSError):
            if b"submitit.core._submit" in Path("/proc", process, "cmdline").read_bytes().split(b"\0"):
                os.kill(int(process), signal.SIGKILL)
                return True
    return False


def run_sweep(slurm: OneNodeSlurm, folder: Path, chance: random.Random, most: int) -> tuple[Counter[str], int]:
    """Run a sweep to its end, with at most so many faults; return these by kind, and how often it was started."""
    faults: Counter[str] = Counter()
    starts, sweep = 1, start(slurm, folder, 0.4)
    try:
        while True:
            time.sleep(chance.uniform(1, 8))
            if sweep.poll() is not None:
                if sweep.returncode == 0:
                    return faults, starts
                starts, sweep = starts + 1, start(slurm, folder, 0.4)
            elif faults.total() < most:
                kind = chance.choice(list(FAULTS))
                faults[kind] += inject(kind, slurm, sweep, folder, chance)
    finally:
        sweep.kill()  # which waits for Slurm as long as there is none


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
    rows, notes = earlier_runs(out, seed)
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
            for row in rows:
                row[f"seed_{seed}"] = faults[KINDS[str(row["fault"])]]
            summary = (
                f"Seed {seed}: {faults.total()} faults in {sweeps} sweeps of {len(SEEDS)} rows, which took {starts} "
                f"starts: {counted['lost']} rows lost, {counted['twice']} finished twice, {counted['other_weights']} "
                f"with other weights than without faults, {counted['again']} steps made twice."
            )
            columns = [(key, key.replace("_", " "), 0) for key in rows[0] if key.startswith("seed_")]
            file.write([("fault", "injected fault", None), *columns], rows, [*notes, summary])


def earlier_runs(out: Path, seed: int) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the rows and notes of the runs of other seeds in a file, rows without counts where there is none."""
    if not out.is_file():
        return [{"fault": text} for text in FAULTS.values()], []
    content = json.loads(out.read_text())
    rows = [{key: value for key, value in row.items() if key != f"seed_{seed}"} for row in content["rows"]]
    return rows, [note for note in content["notes"] if not note.startswith(f"Seed {seed}:")]


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
