"""A queue of three rows, and a row that waits until it is asked to stop."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sci_lightning.studies.tables.row_queue import RowQueue
from sci_lightning.studies.tables.rows import TableRow

ROWS = [TableRow("table3", "rbw_sr", 1, name) for name in ("one", "two", "three")]

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


def queue(folder: Path, script: Callable[[TableRow], str], workers: int = 1) -> tuple[RowQueue, list[str]]:
    finished: list[str] = []

    def command(row: TableRow) -> list[str]:
        return ["-c", script(row), str(folder / row.folder)]

    return RowQueue(ROWS, folder, command, lambda row: finished.append(row.decoder), print, workers), finished
