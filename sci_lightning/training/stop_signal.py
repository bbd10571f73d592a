"""Signals to stop during a training: the first one finishes the step, the next one ends at once."""

from __future__ import annotations

import os
import re
import select
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from sci_lightning.errors import INTERRUPTED, STOPS, TIME_IS_UP, MachineFailure


class Stopped(BaseException):
    """The training stopped because it was asked to; its last checkpoint is written.

    Like :class:`KeyboardInterrupt` it is not an ``Exception``, so that nothing handles it as a failure.
    """


SAME_REQUEST_SECONDS = 0.5
"""Signals within this time are one request: ``timeout`` signals its child and then the child's whole group, a closing
terminal does so beside its shell. Whoever presses Ctrl-C twice in less presses it once more."""

READER_SECONDS = 0.2
"""How long the end of a pipe's reader is waited for: Ctrl-C ends the ``tee`` that shows a training as well."""


class StopSignal:
    """Records a request to stop; use ``with StopSignal() as stop:`` around a command's work.

    Outside of the steps of a training a signal raises ``KeyboardInterrupt`` at once. Between :meth:`wait_for_step` and
    :meth:`act_at_once` the first signal only sets ``requested``, so that the step can be finished, and a later one ends
    the process immediately. A signal that already has a handler, or that is ignored (SIGHUP under ``nohup``), is left
    alone.

    A job of Slurm is asked to stop by SIGTERM, and by SIGUSR1 or SIGUSR2 before its time limit, whoever handled them
    before. Slurm itself ends a job that does not stop, so that further signals change nothing.

    Where the terminal has closed or the reader of a pipe has ended, what is printed after the signal is dropped: it
    would raise an error before the last checkpoint is written.

    Attributes:
        requested: whether a signal arrived.
        lost: returns, in words, what the second signal would lose.
    """

    def __init__(self) -> None:
        self.requested = False
        self.lost: Callable[[], str] = lambda: "the unfinished step"
        self._waiting = False
        self._requested_at = 0.0
        self._before: dict[int, Any] = {}
        self._mine: set[int] = set()
        self._job = os.environ.get("SLURM_JOB_ID")
        self._time_is_up: int | None = None

    def __enter__(self) -> StopSignal:
        if threading.current_thread() is threading.main_thread():  # elsewhere Python allows no handlers
            self._before = {number: signal.getsignal(number) for number in STOPS}
            defaults = (signal.default_int_handler, signal.SIG_DFL)
            self._mine = {number for number, handler in self._before.items() if handler in defaults}
            self._mine |= {signal.SIGTERM, *TIME_IS_UP} if self._job else set()
            self._install()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for number in self._mine:
            signal.signal(number, self._before[number])

    def queue_again(self) -> None:
        """Ask Slurm to start this job once more if its time was up; nothing happens after another signal.

        Raises:
            MachineFailure: submitit has not queued it, because it was started as often as it may be.
            SystemExit: submitit has queued it, whose handler also counts how often.
        """
        if self._job is None or self._time_is_up is None:
            return
        if not callable(handler := self._before[self._time_is_up]):
            subprocess.run(["scontrol", "requeue", self._job], check=False)
            return
        try:
            handler(self._time_is_up, None)
        except Exception as error:
            raise MachineFailure(
                f"its time was up ({error}); the same line goes on, with hydra.launcher.max_num_timeout= more often"
            ) from error

    def wait_for_step(self) -> None:
        """Let the first signal from now on only set ``requested``."""
        self._waiting = True
        self._install()  # a trainer puts its own handlers in place when it starts

    def act_at_once(self) -> None:
        """Let a signal from now on stop the command where it is; one that has arrived does so now."""
        self._waiting = False
        if self.requested:
            raise KeyboardInterrupt

    def _install(self) -> None:
        for number in self._mine:
            signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if number in TIME_IS_UP:
            self._time_is_up = number
        if self.requested:
            if self._job or now - self._requested_at < SAME_REQUEST_SECONDS:
                return
            os._exit(INTERRUPTED)
        self.requested, self._requested_at = True, now
        drop_closed_outputs(hang_up=number == signal.SIGHUP)
        if not self._waiting:
            raise KeyboardInterrupt
        again = "" if self._job else f"; once more ends at once and loses {self.lost()}"
        line = f"\nfinishing the step, then writing last.ckpt{again}"
        print(line, file=sys.stderr, flush=True)


def drop_closed_outputs(hang_up: bool = False) -> None:
    """Let standard output and error lead nowhere if nobody can read them any more.

    Args:
        hang_up: whether the terminal is closing; output to it is dropped even if it is still there for a moment.
    """
    for number in (1, 2):
        try:
            is_file = stat.S_ISREG(os.fstat(number).st_mode)
        except OSError:  # closed from the start
            continue
        poll = select.poll()
        poll.register(number, 0)  # asks for nothing but the end of the other side
        if not is_file and (poll.poll(1000 * READER_SECONDS) or (hang_up and os.isatty(number))):
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)


CONNECTION = re.compile(r"gloo|nccl|connection (reset|closed|refused)|remote process|peer|broken pipe", re.IGNORECASE)
"""Words in the errors of the libraries that connect processes when one of these has ended."""


def lost_process(error: BaseException, out: str | Path) -> MachineFailure | None:
    """Return the failure to report if an error came from the end of another process; None for any other error.

    Args:
        error: what a collective operation raised.
        out: the run's folder.

    Raises:
        SystemExit: another process reports it: the first one, or the second one if the first one died.
    """
    if "MASTER_PORT" not in os.environ or not isinstance(error, RuntimeError) or not CONNECTION.search(str(error)):
        return None
    rank = int(os.environ.get("RANK", os.environ.get("LOCAL_RANK", 0)))
    if rank > 1 or (rank == 1 and os.getppid() > 1 and _is_alive(os.getppid())):
        raise SystemExit(1)
    last = Path(out) / "checkpoints" / "last.ckpt"
    go_on = f"; go on with ckpt_path={last}" if last.is_file() else ""
    return MachineFailure(
        f"one of the processes of this training was ended from outside, and the others ended with it{go_on}"
    )


def _is_alive(process: int) -> bool:
    """Whether a process runs; one that was killed and not yet waited for does not."""
    try:
        status = Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return status.rpartition(")")[2].split()[0] not in "ZX"
