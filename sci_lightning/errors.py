"""The exceptions that are meant for the person at the keyboard."""

from __future__ import annotations

import errno
import os
import re
import signal
from pathlib import Path

FAILING_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Error numbers of a write that fails although its path is right: full disk, quota, file size limit, broken disk."""

WRITE_FAILED = re.compile(
    r"iostream error|inline_container\.cc|PytorchStreamWriter failed|\d requested and \d+ written"
)
"""What torch and NumPy say of a file that they could not write, without the reason."""


TIME_IS_UP = (signal.SIGUSR1, signal.SIGUSR2)
"""Signals that a scheduler sends before it ends a job at its time limit (``sbatch --signal``, submitit)."""

STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, *TIME_IS_UP)
"""Signals that ask a program to stop. Terminals, ``timeout`` and schedulers send them to all of its processes."""

INTERRUPTED = 130
"""Exit status of a command that was asked to stop by one of them, as shells have it for Ctrl-C."""


class BadInput(ValueError):
    """Something the user gave cannot be used.

    The message is one line: what is wrong, where, and what would be right. Commands print it
    without a traceback and exit with status 2; a notebook sees an ordinary ``ValueError``.
    """


class InputWarning(UserWarning):
    """What the user gave was used, but may not be what it seems to be; the message is one line.

    Commands print it as one line that begins with ``warning:``; a notebook sees an ordinary warning.
    """


class MachineFailure(RuntimeError):
    """The machine could not do what was rightly asked of it, for example because a disk is full.

    The message is one line: what failed, where, and what to do. Commands print it without a traceback and exit with
    status 1, because the same input works once the machine does.
    """


def describe(error: BaseException) -> str:
    """Return what went wrong as one line."""
    if failure := as_machine_failure(error):
        return str(failure)
    text = " ".join(str(error).split())
    return text if isinstance(error, BadInput) else f"{type(error).__name__}: {text}"


def as_machine_failure(error: BaseException, path: str | Path | None = None) -> MachineFailure | None:
    """Return the :class:`MachineFailure` that an exception raised while writing stands for; None for any other.

    Libraries wrap the system's error: HDF5, torch and safetensors raise errors of their own, with its number or text.

    Args:
        error: what was raised.
        path: the file being written; None: the one that the error names.
    """
    seen: BaseException | None = error
    passed: list[BaseException] = []
    while seen is not None and seen not in passed:  # causes and contexts can lead back to where they came from
        passed.append(seen)
        if isinstance(seen, MachineFailure):
            return seen
        if isinstance(seen, BadInput):  # whoever raised it has judged its cause: a file that lies about its size
            return None
        if isinstance(seen, MemoryError):
            return MachineFailure(
                "this machine's memory is exhausted; give a smaller size, fewer frames or a smaller batch"
            )
        if isinstance(seen, OSError) and seen.errno in FAILING_DISK:
            return _failure(path or seen.filename, os.strerror(seen.errno))
        for number in FAILING_DISK:
            if os.strerror(number) in str(seen):
                return _failure(path, os.strerror(number))
        if WRITE_FAILED.search(str(seen)):
            return _failure(path, "the file could not be written whole, which a full disk does")
        seen = seen.__cause__ or seen.__context__
    return None


def _failure(path: str | Path | None, reason: str) -> MachineFailure:
    where = f"{path}: " if path else ""
    return MachineFailure(
        f"{where}{reason[0].lower()}{reason[1:]}; free some space or write to another disk "
        "(what was there before is unchanged)"
    )


class TrainingDiverged(MachineFailure):
    """A training's loss or gradient is no longer finite.

    Nothing that the user gave was malformed, so that commands report it as they report a failure of the machine: one
    line without a traceback, exit status 1.
    """


class TrainingFailed(MachineFailure):
    """A training's validation stays below the mean measurement; reported like :class:`TrainingDiverged`."""


class OtherSize(BadInput):
    """Scenes of another size than the mask's; ``size`` is theirs, height and width in pixels."""

    def __init__(self, line: str, size: tuple[int, ...]) -> None:
        super().__init__(line)
        self.size = size


class NoSuchCombination(BadInput):
    """Two settings that are right by themselves do not go together, such as four bits and a binary mask.

    A sweep skips such a row; anywhere else it is bad input like any other.
    """
