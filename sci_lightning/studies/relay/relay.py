"""The relay: large trainings that go on, a lease of minutes at a time, on whatever machine has a GPU just now.

A lease of a training is a training of its own: it begins from the weights that the last one left, with a fresh
optimizer, a short warm-up and clips of its own, goes on at constant learning rates, lets them fall at its end, and is
tested. What is left behind is small: the weights (in bfloat16 where they are many), the scores, and the queue that says
what was done.
"""

from __future__ import annotations

import json
import math
import shutil
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.json_file import read_json, write_json
from sci_lightning.runs.provenance import commit, machine_name, provenance_now
from sci_lightning.runs.results import RunMetrics
from sci_lightning.runs.run_folder import is_locked
from sci_lightning.studies.relay.lease_processes import Leased, LeaseProcesses
from sci_lightning.studies.relay.relay_archive import pack, unpack
from sci_lightning.studies.relay.relay_queue import Lease, RelayQueue, RelayTraining
from sci_lightning.studies.tables.rows import without_places

LARGEST_FLOAT32 = 14 * 2**20
"""Bytes of weights that travel as they are; more are rounded to bfloat16."""

LEAST_SECONDS = 10.0
"""Shortest training for which a lease is worth its start."""

LEASE_END = "sci_lightning.training.learning_rates.LeaseEnd"
"""Not imported: Lightning takes seconds, which each training needs for itself."""

CHECKPOINTS = 8
"""Checkpoints of a lease at least: one that is cut off loses this part of it at most."""

BRING_SECONDS = 30.0
"""Between two copies to the archive while nothing else asks for one."""
LEFT = {("results", ".json"), ("state", ".safetensors")}
"""What an archive holds beside the queue: measured results, and weights to go on with."""


@dataclass
class Relay:
    """Gives the next trainings of a queue their leases.

    Attributes:
        path: of the queue. What is kept of tests lies beside it, under ``tables/relay``, ``tables`` and ``benchmark``.
        state: folder of the weights and of the trainings that run.
        seconds: of everything; what is not finished then is cut off, and nothing of it is lost but its test.
        reserve: seconds of it for the test of a training.
        footage: folder of clips and scenes, which stands for ``{footage}`` in recipes.
        override: writes a key and a value as command lines take them.
        say: called with lines of news.
        archive: folder to which all that a lease leaves is copied, see
            :mod:`~sci_lightning.studies.relay.relay_archive`; None for none.
    """

    path: Path
    state: Path
    seconds: float
    reserve: float
    footage: Path
    override: Callable[[str, str | Path], str]
    say: Callable[[str], None] = print
    archive: Path | None = None
    _begun: float = field(default_factory=time.time)
    _exported: dict[str, float] = field(default_factory=dict)
    _started: dict[str, float] = field(default_factory=dict)
    _brought: float = field(default_factory=time.time)

    def __post_init__(self) -> None:
        if self.seconds < self.reserve + LEAST_SECONDS:
            raise BadInput(
                f"seconds={self.seconds:g}: at least {LEAST_SECONDS:g} more than reserve={self.reserve:g}, which the "
                "test takes"
            )
        self.queue = read_json(self.path, RelayQueue)

    def run(self) -> None:
        """Give leases until the seconds are over or nothing is wanted any more.

        Raises:
            MachineFailure: trainings that failed; the others got their leases.
            KeyboardInterrupt: asked to stop; what was trained until then is kept.
        """
        until = time.monotonic() + self.seconds
        for training in self.queue.trainings:
            self._recover(training)
        failed: dict[str, str] = {}
        while trainings := self.queue.following(set(failed)):
            left = until - time.monotonic()
            if left < self.reserve + LEAST_SECONDS:
                break
            failed |= self._lease(trainings, left)
        else:
            self.say("nothing more is wanted")
        if failed:
            raise MachineFailure("; ".join(f"{name}: {reason}" for name, reason in failed.items()))

    def take(self, folder: Path) -> None:
        """Take over what a lease on another machine has left in an archive.

        Only leases are taken over: what is run stands in this queue alone, and results that are here already stay, but
        for the rows of the relay's own trainings.

        Raises:
            BadInput: no such archive, one of a queue that does not go on from the present one, or one that holds
                anything else than a lease leaves; nothing has been written then.
        """
        files = unpack(folder)
        try:
            queue = RelayQueue.model_validate_json(files.pop("queue.json"))
        except (KeyError, ValueError) as error:
            raise BadInput(f"{folder}: holds no queue of the relay") from error
        queue.check_follows(self.queue)
        taken = {self._place(folder, name, content): content for name, content in files.items()}
        for path, content in taken.items():
            with atomic_write(path) as temporary:
                temporary.write_bytes(content)
        self._write(queue)

    def _place(self, folder: Path, name: str, content: bytes) -> Path:
        """Return where a file of an archive belongs; what no lease leaves is refused."""
        root, _, rest = name.partition("/")
        path = {"results": self.path.parent, "state": self.state}.get(root, folder) / rest
        if (root, path.suffix) not in LEFT or path.is_dir() or path == self.path:
            raise BadInput(f"{folder}: holds {name}, which no lease leaves")
        if root == "results":
            own = path.is_relative_to(self._rows)  # which every lease writes anew
            if not own and path.is_file() and path.read_bytes() != content:
                raise BadInput(f"{folder}: holds {name}, which is here already and says something else")
            try:
                json.loads(content)
            except ValueError as error:
                raise BadInput(f"{folder}: {name} is no JSON ({error})") from error
        return path

    def recipe(self, training: RelayTraining) -> list[str]:
        """Return the overrides of a training, with the folder of the footage in them."""
        return [word.replace("{footage}", str(self.footage)) for word in training.recipe]

    def _lease(self, trainings: Iterable[RelayTraining], seconds: float) -> dict[str, str]:
        """Run the trainings at once; returns why those failed that did, by their names."""
        rows = [Leased(training.name, len(training.leases)) for training in trainings]

        def command(row: Leased) -> list[str]:
            return self._command(self.queue.training(row.name), row, seconds - self.reserve)

        def export() -> None:
            for row in rows:
                self._export(row)
            if time.time() - self._brought > BRING_SECONDS:
                self._bring()  # what the rows of tables have left by now

        for row in rows:
            self._started[row.name] = time.monotonic()
            about = self.queue.training(row.name)
            self.say(f"{row.name}, lease {row.number + 1}: {about.what}")
        processes = LeaseProcesses(rows, self.state, command, self._finished, self.say, seconds, export)
        processes.run()
        for row in rows:
            self._end(row)
        return {row.name: reason for row, reason in processes.failed.items()}

    def _command(self, training: RelayTraining, row: Leased, seconds: float) -> list[str]:
        """Return the words that run a training, or another command, in its folder."""
        words = ["-m", f"sci_lightning.{training.command}", *self.recipe(training)]
        words.append(self.override("out", str(self.state / row.folder)))
        if training.command == "tables.rows":
            words.append(self.override("results", str(self.path.parent / "tables")))
        if training.command != "train":
            return words
        weights = self._weights(training.name)
        start = [self.override("ckpt_path", str(weights))] if weights.is_file() else []
        lease = "callbacks.lease"
        limits = [
            f"+{lease}._target_={LEASE_END}",
            f"+{lease}.until={time.time() + seconds:.0f}",
            f"callbacks.last.every_minutes={min(0.5, seconds / 60 / CHECKPOINTS):.3f}",
            *("trainer.max_time=null", "core_minutes=null"),
        ]
        seeds = [f"{part}.seed={row.number}" for part in ("data", "system")]  # other clips, windows and noise
        return [*words, *start, *limits, *seeds]

    def _export(self, row: Leased) -> None:
        """Keep the weights of a training's last checkpoint, if it has written another one, and what led to them."""
        checkpoint = self.state / row.folder / "checkpoints" / "last.ckpt"
        if not checkpoint.is_file() or self._exported.get(row.name) == checkpoint.stat().st_mtime:
            return
        from sci_lightning.runs.checkpoint import load_file, write_weights

        self._exported[row.name] = checkpoint.stat().st_mtime
        content = load_file(checkpoint)
        state, rounded = _small(content["state_dict"])
        write_weights(self._weights(row.name), content["config"], state)
        steps = int(content["position"]["steps"])
        seconds = float(content["callbacks"][LEASE_END.rpartition(".")[2]]["time_elapsed"]["train"])
        clips = (
            steps * int(content["config"]["batch_size"]) * int(content["config"]["trainer"]["accumulate_grad_batches"])
        )
        self._give(
            row,
            Lease(
                date=_today(),
                machine=_machine(),
                commit=commit(),
                seconds=seconds,
                steps=steps,
                clips=clips,
                finished=False,
                weights=rounded,
            ),
        )
        self._bring()

    def _recover(self, training: RelayTraining) -> None:
        """Keep what a lease that was killed has left in the training's folder, once its processes have ended."""
        for folder in sorted((self.state / training.name).glob("lease_*")) if training.command == "train" else ():
            while is_locked(folder):
                time.sleep(0.2)
            self._end(Leased(training.name, int(folder.name.removeprefix("lease_")) - 1))

    def _end(self, row: Leased) -> None:
        """Keep what a training that was cut off or killed has left; one that was tested before has finished."""
        run = self.state / row.folder
        if self.queue.training(row.name).command == "train" and run.is_dir():
            self._export(row)
            if (run / "metrics.json").is_file():
                self._finished(row)
            else:
                shutil.rmtree(run)

    def _finished(self, row: Leased) -> None:
        """Keep the results of a training that was tested, or of a command that has ended."""
        run, spent = self.state / row.folder, time.monotonic() - self._started.get(row.name, math.inf)
        kind = self.queue.training(row.name).command
        if kind == "train":
            self._export(row)
            scores = read_json(run / "metrics.json", RunMetrics)
            lease = self.queue.training(row.name).leases[row.number]
            more = {"machine": _machine(scores.device), "finished": True, "overhead": max(0.0, spent - lease.seconds)}
            self._give(row, lease.model_copy(update={**more, "mean": scores.mean, "scenes": scores.scenes}))
            self._keep(row, json.loads((run / "metrics.json").read_text()))
            shutil.rmtree(run)
            self.say(f"{row.name}, lease {row.number + 1}: {scores.mean['psnr']:.2f} dB")
        else:
            if kind == "benchmark":
                with atomic_write(self.path.parent / "benchmark" / f"{row.name}.json") as temporary:
                    shutil.copyfile(run / "benchmark.json", temporary)
            self._give(
                row,
                Lease(
                    date=_today(), machine=_machine(), commit=commit(), seconds=spent, steps=0, clips=0, finished=True
                ),
            )
        self._bring()

    def _keep(self, row: Leased, metrics: dict[str, Any]) -> None:
        """Keep the metrics of a training as they are after all of its leases, where the tables look for them."""
        leases = self.queue.training(row.name).leases
        seconds = sum(lease.seconds for lease in leases)
        scale = f"relay, {len(leases)} lease{'s' * (len(leases) > 1)}, {seconds:.0f} seconds of training"
        made_by = f"python -m sci_lightning.tables.relay seconds={self.seconds:g}"
        kept = {
            **without_places(metrics),
            "training_steps": sum(lease.steps for lease in leases),
            "clips_seen": sum(lease.clips for lease in leases),
            "provenance": provenance_now(leases[-1].machine, scale, [row.seed], made_by).as_json(),
        }
        write_json(kept, self._rows / row.name / f"seed{row.seed}.json")

    def _give(self, row: Leased, lease: Lease) -> None:
        self._write(self.queue.given(row.name, lease, row.number))

    def _write(self, queue: RelayQueue) -> None:
        self.queue = queue
        write_json(queue.as_json(), self.path)

    def _bring(self) -> None:
        """Copy the queue and all that this process has written beside it, and the weights, to the archive."""
        self._brought = time.time()
        if self.archive is None:
            return
        files = {"queue.json": self.path}
        for name, ending in sorted(LEFT):
            root = {"results": self.path.parent, "state": self.state}[name]
            for path in sorted(root.rglob(f"*{ending}")):
                if path != self.path and path.stat().st_mtime >= self._begun:
                    files[f"{name}/{path.relative_to(root).as_posix()}"] = path
        pack(files, self.archive)

    @property
    def _rows(self) -> Path:
        """The folder of the relay's own rows."""
        return self.path.parent / "tables" / "relay"

    def _weights(self, name: str) -> Path:
        return self.state / name / "weights.safetensors"


def _small(state: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """Return the weights as they travel, and in which precision; a mask stays as it is, its levels depend on it."""
    import torch

    if sum(value.nbytes for value in state.values()) <= LARGEST_FLOAT32:
        return state, "float32"
    rounded = {
        key: value.bfloat16() if key.startswith("decoder.") and value.dtype == torch.float32 else value
        for key, value in state.items()
    }
    return rounded, "bfloat16, the mask float32"


def _today() -> str:
    return datetime.now(timezone.utc).date().isoformat()


def _machine(device: str = "") -> str:
    """Return the name of a GPU that trained, by default the one that is here, or else of the processor."""
    from sci_lightning.runs.device import device_name, is_processor, resolve_device

    device = device or device_name(resolve_device("auto"))
    return machine_name(1) if is_processor(device) else device
