"""Ctrl-C and SIGTERM while a command trains: a first one finishes the step, a second one ends at once."""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType, TracebackType
from typing import Any

STATUS = 130
"""Exit status of a command that was asked to stop, by Ctrl-C or by SIGTERM."""


class Stopped(BaseException):
    """The training stopped because it was asked to; its last checkpoint is written.

    Like :class:`KeyboardInterrupt` no ``Exception``: nothing that handles failures is to take it for one.
    """


class StopSignal:
    """Notes that somebody asked to stop; ``with StopSignal() as stop:`` around a command's work.

    Outside of the steps of a training a signal raises ``KeyboardInterrupt`` at once. Between :meth:`wait_for_step` and
    :meth:`act_at_once` the first one sets ``requested``, for whoever is able to finish the step, and the second one
    ends the process there and then. A signal that somebody else handles already (the launcher of a cluster, which
    queues the job again) is left alone.

    Attributes:
        requested: whether a signal arrived.
    """

    def __init__(self) -> None:
        self.requested = False
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
        """Leave a signal to others from now on."""
        if number in self._mine:
            self._mine.remove(number)
            signal.signal(number, self._before[number])

    def wait_for_step(self) -> None:
        """From now on a first signal only sets ``requested``."""
        self._waiting = True
        self._install()  # a trainer puts its own handlers in place when it starts

    def act_at_once(self) -> None:
        """From now on a signal stops the command where it is."""
        self._waiting = False
        if self.requested:
            raise KeyboardInterrupt

    def _install(self) -> None:
        for number in self._mine:
            signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            os._exit(STATUS)
        self.requested = True
        if not self._waiting:
            raise KeyboardInterrupt
        print("\nfinishing the step, then writing last.ckpt; once more ends at once", file=sys.stderr, flush=True)
