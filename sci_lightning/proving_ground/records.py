"""What became of the cases: a folder with one JSON file for each."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import whole_file
from sci_lightning.proving_ground.case import Case


class Records:
    """The records under a folder, whole or absent each.

    Args:
        folder: is made when there is something to write.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def write(self, record: Mapping[str, Any]) -> None:
        """Keep a record, in the place of an earlier one of the same case."""
        with whole_file(self.folder / f"{record['case']}.json") as temporary:
            temporary.write_text(json.dumps(record, indent=1) + "\n")

    def read(self) -> list[dict[str, Any]]:
        """All of them, by name.

        Raises:
            BadInput: a file that is no record.
        """
        return [_read(path) for path in sorted(self.folder.glob("[!.]*.json"))]

    def has(self, case: Case) -> bool:
        """Whether the case, with these very settings, has come to an end; one that failed is worth another try."""
        path = self.folder / f"{case.name}.json"
        record = _read(path) if path.exists() else {}
        return record.get("digest") == case.digest and "failed" not in record


def _read(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text())
        assert isinstance(record, dict) and record["format"] == "sci-proving-ground-case"
        assert record["format_version"] == 1
    except (ValueError, KeyError, AssertionError) as error:
        raise BadInput(f"{path}: not a record of the proving ground, format_version 1; move it elsewhere") from error
    return record
