"""A measured table with its figure that is made of files alone, without any run: as JSON, Markdown and PNG."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from sci_lightning.figures.figure import write_figure
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.json_file import write_json
from sci_lightning.runs.provenance import provenance_now
from sci_lightning.studies.tables.documented import measurements
from sci_lightning.studies.tables.grid import DocumentedTable


@dataclass(frozen=True)
class FileStudy:
    """What was made of the files.

    Attributes:
        name: of what is written.
        columns, rows, notes: as of :class:`~sci_lightning.studies.tables.documented.Measurements`.
        figure: what goes with them.
        scale: of what was measured, for the provenance.
    """

    name: str
    columns: Sequence[dict[str, Any]]
    rows: list[dict[str, Any]]
    notes: list[str]
    figure: Figure
    scale: str

    def write(self, folder: str | Path, command: str) -> DocumentedTable:
        """Write NAME.json, NAME.md and NAME.png into a folder; returns the table.

        Args:
            folder: of the files.
            command: that made this, without the places of the files that it read.
        """
        folder = Path(folder)
        content = {
            "format": "sci-measurements",
            "format_version": 1,
            "provenance": provenance_now("computed from files", self.scale, [], command).as_json(),
            "columns": list(self.columns),
            "rows": self.rows,
            "notes": self.notes,
        }
        write_json(content, folder / f"{self.name}.json")
        table = measurements(folder / f"{self.name}.json", "")
        with atomic_write(folder / f"{self.name}.md") as temporary:
            temporary.write_text(table.as_markdown(), encoding="utf-8")
        write_figure(self.figure, folder / f"{self.name}.png")
        return table
