"""The processes of one lease: what is killed goes on in the next one, what failed stops no other."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sci_lightning.errors import INTERRUPTED

PR_SET_PDEATHSIG = 1
"""Linux's number for: send me a signal when the process that started me ends."""


@dataclass(frozen=True)
class Leased:
    """A training in its present lease; ``number`` counts its leases from 0."""

    name: str
    number: int
    seed: int = 0

    @property
    def folder(self) -> str:
        """Its folder below that of all."""
        return f"{self.name}/lease_{self.number + 1}"


@dataclass
class LeaseProcesses:
    """Runs commands at the same time, each in a process of its own that computes on one thread.

    When this process ends, however it ends, they are asked to stop: each training writes a checkpoint after its current
    step.

    Attributes:
        leased: what is run.
        folder: each writes a folder below it, and a log beside them.
        command: the words that run it, without the program: ``-m sci_lightning.train experiment=..``.
        finished: called with one whose command has ended well.
        say: called with a line of news.
        seconds: after which those that run are asked to stop.
        watch: called several times a second while they run, and once after the last has ended.
        failed: those that failed, each with a line that says why.
    """

    leased: Sequence[Leased]
    folder: Path
    command: Callable[[Leased], list[str]]
    finished: Callable[[Leased], None]
    say: Callable[[str], None]
    seconds: float
    watch: Callable[[], None]
    failed: dict[Leased, str] = field(default_factory=dict)
    _running: dict[Leased, subprocess.Popen[bytes]] = field(default_factory=dict)
    _stopping: bool = False
    _interrupted: bool = False

    def run(self) -> None:
        """Run all; returns when each has finished or failed, or was asked to stop because the time was over.

        Raises:
            KeyboardInterrupt: after SIGINT or SIGTERM, when all that were running have written a checkpoint.
        """
        until = time.monotonic() + self.seconds
        before = {number: signal.signal(number, self._interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            for one in self.leased:
                self._start(one)
            while self._running:
                if self._interrupted or time.monotonic() > until:
                    self._ask_to_stop()
                time.sleep(0.2)
                self.watch()
                for one in [one for one, process in self._running.items() if process.poll() is not None]:
                    self._end(one, self._running.pop(one).returncode)
            if self._interrupted:
                raise KeyboardInterrupt
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
            self.watch()

    def log(self, one: Leased) -> Path:
        """Return the file that holds what a command printed."""
        return self.folder / "logs" / f"{one.name}_seed{one.seed}.txt"

    def _start(self, one: Leased) -> None:
        self.log(one).parent.mkdir(parents=True, exist_ok=True)
        with self.log(one).open("ab") as log:
            self._running[one] = subprocess.Popen(
                [sys.executable, *self.command(one)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env={**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"},
                start_new_session=True,  # Ctrl-C reaches this process alone, which passes it on once
                preexec_fn=_stop_with_parent,
            )
        self.say(f"started {one.name}, seed {one.seed}")

    def _end(self, one: Leased, status: int) -> None:
        if status == 0:
            try:
                self.finished(one)
            except Exception as error:
                self.failed[one] = f"its results cannot be kept: {error}"
        elif not (self._stopping and status in (INTERRUPTED, -signal.SIGTERM)):
            lines = [line for line in self.log(one).read_text(errors="replace").splitlines() if line.strip()]
            self.failed[one] = f"status {status}: {lines[-1] if lines else 'it printed nothing'} ({self.log(one)})"
            self.say(f"failed {one.name}, seed {one.seed}: {self.failed[one]}")

    def _interrupt(self, *_: object) -> None:
        self._interrupted = True

    def _ask_to_stop(self) -> None:
        """Ask every command that runs to write a checkpoint and to end, once."""
        if not self._stopping:
            self._stopping = True
            for process in self._running.values():
                process.send_signal(signal.SIGTERM)


def _stop_with_parent() -> None:
    """Have Linux send SIGTERM to this process when the one that started it is killed; elsewhere it runs to its end."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
