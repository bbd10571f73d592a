"""Three commands of a lease, and one that waits until it is asked to stop."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sci_lightning.studies.relay.lease_processes import Leased, LeaseProcesses

LEASED = [Leased(name, 0) for name in ("one", "two", "three")]

WAITS = """
import pathlib, signal, sys
from sci_lightning.runs.run_folder import run_folder
place = pathlib.Path(sys.argv[1])
def stop(*_):
    (place / "asked").touch()
    sys.exit(130)
signal.signal(signal.SIGTERM, stop)
with run_folder(place):
    (place / "running").touch()
    signal.pause()
"""
"""Stands for a training: takes its folder, and ends when it is asked to, with the status of a stopped one."""


def processes(
    folder: Path, script: Callable[[Leased], str], seconds: float = 600.0
) -> tuple[LeaseProcesses, list[str]]:
    finished: list[str] = []

    def command(one: Leased) -> list[str]:
        return ["-c", script(one), str(folder / one.folder)]

    def end(one: Leased) -> None:
        finished.append(one.name)

    return LeaseProcesses(LEASED, folder, command, end, print, seconds, lambda: None), finished
