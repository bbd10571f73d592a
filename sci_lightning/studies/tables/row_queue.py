"""A queue of trainings in processes of their own: what is killed goes on the next time, what failed stops no other."""

from __future__ import annotations

import ctypes
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from sci_lightning.errors import INTERRUPTED
from sci_lightning.runs.run_folder import is_locked

PR_SET_PDEATHSIG = 1
"""Linux's number for: send me a signal when the process that started me ends."""


class Row(Protocol):
    """What is run: its ``folder`` lies below that of the queue, ``name`` and ``seed`` say in words which it is."""

    @property
    def name(self) -> str: ...
    @property
    def folder(self) -> str: ...
    @property
    def seed(self) -> int: ...


AnyRow = TypeVar("AnyRow", bound=Row)


@dataclass
class RowQueue(Generic[AnyRow]):
    """Runs ``train`` for one row after the other, a few at a time.

    A row's process computes on one thread. When this process ends, however it ends, its rows are asked to stop: each
    writes a checkpoint after its current step. The next queue waits until they have, and goes on from there.

    Attributes:
        rows: in their order.
        folder: each training writes a folder below it, and a log beside them.
        command: the words that train a row, without the program: ``-m sci_lightning.train experiment=..``.
        finished: called with a row whose training has ended well.
        say: called with a line of news.
        workers: rows that run at the same time.
        seconds: after which rows that run are asked to stop, and no other is started.
        watch: called several times a second while rows run, and once after the last has ended.
        failed: rows that failed, each with a line that says why.
    """

    rows: Sequence[AnyRow]
    folder: Path
    command: Callable[[AnyRow], list[str]]
    finished: Callable[[AnyRow], None]
    say: Callable[[str], None]
    workers: int = 1
    seconds: float = math.inf
    watch: Callable[[], None] = lambda: None
    failed: dict[AnyRow, str] = field(default_factory=dict)
    _running: dict[AnyRow, subprocess.Popen[bytes]] = field(default_factory=dict)
    _stopping: bool = False

    def run(self) -> None:
        """Run all rows; returns when every row has finished or failed.

        Raises:
            KeyboardInterrupt: after SIGINT or SIGTERM, when all rows that were running have written a checkpoint.
        """
        waiting, until = list(self.rows), time.monotonic() + self.seconds
        before = {number: signal.signal(number, self._stop) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            while waiting or self._running:
                over = time.monotonic() > until
                if over:
                    self._ask_to_stop()
                if not (over or self._stopping):
                    self._start(waiting)
                elif not self._running:
                    if over:
                        return
                    raise KeyboardInterrupt
                time.sleep(0.2)
                self.watch()
                for row in [row for row, process in self._running.items() if process.poll() is not None]:
                    self._end(row, self._running.pop(row).returncode)
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            self.watch()

    def log(self, row: AnyRow) -> Path:
        """Return the file that holds what a row's training printed."""
        return self.folder / "logs" / f"{row.name}_seed{row.seed}.txt"

    def _start(self, waiting: list[AnyRow]) -> None:
        """Start the first rows that wait and whose folder nobody writes: a killed queue's rows may not have ended."""
        for row in list(waiting):
            if len(self._running) >= self.workers:
                return
            if is_locked(self.folder / row.folder):
                continue
            waiting.remove(row)
            self.log(row).parent.mkdir(parents=True, exist_ok=True)
            with self.log(row).open("ab") as log:
                self._running[row] = subprocess.Popen(
                    [sys.executable, *self.command(row)],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    env={**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"},
                    start_new_session=True,  # Ctrl-C reaches this process alone, which passes it on once
                    preexec_fn=_stop_with_parent,
                )
            self.say(f"started {row.name}, seed {row.seed}")

    def _end(self, row: AnyRow, status: int) -> None:
        if status == 0:
            try:
                self.finished(row)
            except Exception as error:
                self.failed[row] = f"its results cannot be kept: {error}"
        elif not (self._stopping and status in (INTERRUPTED, -signal.SIGTERM)):
            lines = [line for line in self.log(row).read_text(errors="replace").splitlines() if line.strip()]
            self.failed[row] = f"status {status}: {lines[-1] if lines else 'it printed nothing'} ({self.log(row)})"
            self.say(f"failed {row.name}, seed {row.seed}: {self.failed[row]}")

    def _stop(self, *_: object) -> None:
        self._ask_to_stop()

    def _ask_to_stop(self) -> None:
        """Ask every running row to write a checkpoint and to end; start no other."""
        if not self._stopping:
            self._stopping = True
            for process in self._running.values():
                process.send_signal(signal.SIGTERM)


def _stop_with_parent() -> None:
    """Have Linux send SIGTERM to this process when the one that started it is killed; elsewhere it runs to its end."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
