"""The records of a proving ground: a folder with one JSON file for every case."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.proving_ground.case import Case
from sci_lightning.proving_ground.outcome import Failure, Outcome, parse_record


class Records:
    """The records in a folder; no file is ever half written.

    Args:
        folder: is created when the first record is written.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def write(self, record: Mapping[str, Any]) -> None:
        """Write a record; it replaces an earlier one of the same case."""
        with atomic_write(self.folder / f"{record['case']}.json") as temporary:
            temporary.write_text(json.dumps(record, indent=1) + "\n")

    def read(self) -> list[Outcome | Failure]:
        """Read all records, in the order of their names.

        Raises:
            BadInput: a file is no record.
        """
        return [_read(path) for path in sorted(self.folder.glob("[!.]*.json"))]

    def has(self, case: Case) -> bool:
        """Return whether this case, with exactly these settings, has been completed; failed cases are run again."""
        path = self.folder / f"{case.name}.json"
        if not path.exists():
            return False
        record = _read(path)
        return isinstance(record, Outcome) and record.digest == case.digest


def _read(path: Path) -> Outcome | Failure:
    try:
        return parse_record(json.loads(path.read_text()))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise BadInput(f"{path}: not a record of the proving ground, format_version 1; move it elsewhere") from error
