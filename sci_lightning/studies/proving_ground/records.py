"""The records of a proving ground: a file with one line of JSON for every case that has ended."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput, as_machine_failure
from sci_lightning.files.atomic_file import sync_folder
from sci_lightning.studies.proving_ground.case import Case
from sci_lightning.studies.proving_ground.outcome import Failure, Outcome, parse_record

START = b'{"format":"sci-proving-ground-case",'
"""How every line begins, by which one that was cut off is told from something else."""


class Records:
    """The records in a file, ``cases.jsonl``.

    Every record is a line, written and on the disk before the next case begins. A process that is killed in the midst
    of a line leaves a last line without an end: it is no record, and the next one takes its place.

    Args:
        path: of the file; it and its folder are made when the first record is written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def write(self, record: Mapping[str, Any]) -> None:
        """Add a record; it stands for an earlier one of the same case, too.

        Raises:
            MachineFailure: the disk is full or broken. The records before are unchanged.
        """
        line = json.dumps(record, separators=(",", ":")).encode() + b"\n"
        new = not self.path.exists()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab+") as file:
                file.truncate(_end_of_lines(file))
                file.write(line)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            if failure := as_machine_failure(error, self.path):
                raise failure from error
            raise
        if new:
            sync_folder(self.path.parent)

    def read(self) -> list[Outcome | Failure]:
        """Read the last record of every case, in the order of their names; none if there is no file.

        Raises:
            BadInput: a line is no record.
        """
        content = self.path.read_bytes() if self.path.exists() else b""
        *lines, torn = content.split(b"\n")
        records: dict[str, Outcome | Failure] = {}
        what = "not a record of the proving ground, format_version 1; move the file elsewhere"
        for number, line in enumerate(lines, start=1):
            try:
                record = parse_record(json.loads(line))
            except (ValueError, TypeError) as error:
                raise BadInput(f"{self.path}, line {number}: {what}") from error
            records[record.case] = record
        if torn[: len(START)] != START[: len(torn)]:
            raise BadInput(f"{self.path}, line {len(lines) + 1}: {what}")
        return [records[case] for case in sorted(records)]

    def missing(self, cases: Iterable[Case]) -> list[Case]:
        """Return the cases that have not been completed with exactly these settings; failed ones are to run again."""
        completed = {record.digest for record in self.read() if isinstance(record, Outcome)}
        return [case for case in cases if case.digest not in completed]


def _end_of_lines(file: Any) -> int:
    """Return the length of a file without a last line that has no end."""
    file.seek(0)
    content: bytes = file.read()
    return content.rfind(b"\n") + 1
