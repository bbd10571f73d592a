"""Ctrl-C and SIGTERM during a training: the first one finishes the step, the second one ends at once."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

from sci_lightning.errors import INTERRUPTED


class Stopped(BaseException):
    """The training stopped because it was asked to; its last checkpoint is written.

    Like :class:`KeyboardInterrupt` it is not an ``Exception``, so that nothing handles it as a failure.
    """


class StopSignal:
    """Records a request to stop; use ``with StopSignal() as stop:`` around a command's work.

    Outside of the steps of a training a signal raises ``KeyboardInterrupt`` at once. Between :meth:`wait_for_step` and
    :meth:`act_at_once` the first signal only sets ``requested``, so that the step can be finished, and the second one
    ends the process immediately. A signal that already has a handler (of a cluster's launcher, which requeues the job)
    is left alone.

    Attributes:
        requested: whether a signal arrived.
        lost: returns, in words, what the second signal would lose.
    """

    def __init__(self) -> None:
        self.requested = False
        self.lost: Callable[[], str] = lambda: "the unfinished step"
        self._waiting = False
        self._before: dict[int, Any] = {}
        self._mine: set[int] = set()

    def __enter__(self) -> StopSignal:
        if threading.current_thread() is threading.main_thread():  # elsewhere Python allows no handlers
            defaults = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
            self._before = {number: signal.getsignal(number) for number in defaults}
            self._mine = {number for number, handler in defaults.items() if self._before[number] == handler}
            self._install()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for number in self._mine:
            signal.signal(number, self._before[number])

    def leave(self, number: int) -> None:
        """Restore the former handler of a signal."""
        if number in self._mine:
            self._mine.remove(number)
            signal.signal(number, self._before[number])

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
        if self.requested:
            os._exit(INTERRUPTED)
        self.requested = True
        if not self._waiting:
            raise KeyboardInterrupt
        line = f"\nfinishing the step, then writing last.ckpt; once more ends at once and loses {self.lost()}"
        print(line, file=sys.stderr, flush=True)
