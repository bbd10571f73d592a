"""A table of text: on the terminal, as Markdown, LaTeX and PNG, and on a page of the documentation."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure
from rich import box
from rich.table import Table

from sci_lightning.figures.figure import write_figure
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.plain_text import file_name, in_figure, in_latex, in_markdown, markdown_table
from sci_lightning.runs.provenance import Provenance

MOST_DRAWN = 150
"""Rows of the PNG; a picture of more could not be looked at. The other formats hold all."""


@dataclass(frozen=True)
class Grid:
    """A heading over rows of cells. Texts may come from anywhere: each format shows them as they are.

    Attributes:
        name: of the files; what does not belong in a file name is replaced.
        title: above the table.
        heading: one text for each column.
        rows: as many cells each.
        notes: sentences below the table.
    """

    name: str
    title: str
    heading: list[str]
    rows: list[list[str]]
    notes: list[str] = field(default_factory=list)

    def write(self, folder: str | Path) -> list[Path]:
        """Write NAME.md, NAME.tex and NAME.png; returns their paths."""
        folder, name = Path(folder), file_name(self.name)
        texts = {"md": self.as_markdown(), "tex": self.as_latex()}
        for ending, text in texts.items():
            with atomic_write(folder / f"{name}.{ending}") as temporary:
                temporary.write_text(text, encoding="utf-8")
        write_figure(self.as_figure(), folder / f"{name}.png")
        return [folder / f"{name}.{ending}" for ending in (*texts, "png")]

    def as_table(self, width: int | None = None) -> Table:
        """For a terminal of so many columns; where a row's words do not fit side by side, its cells are listed."""
        caption = "\n".join(self.notes) or None
        table = Table(title=self.title, title_justify="left", caption=caption, caption_justify="left", box=box.SIMPLE)
        if width is not None and self._narrowest() > width:
            table.show_header = False
            table.add_column(no_wrap=True)
            table.add_column(overflow="fold")
            for row in self.rows:
                for text, cell in zip(self.heading, row, strict=True):
                    table.add_row(text, cell)
                table.add_section()
            return table
        for text in self.heading:
            table.add_column(text)
        for row in self.rows:
            table.add_row(*row)
        return table

    def _narrowest(self) -> int:
        """How wide the table is when every cell is folded between its words: with a margin on either side."""
        columns = zip(self.heading, *self.rows, strict=True)
        return sum(3 + max(len(word) for cell in column for word in cell.split() or [""]) for column in columns)

    def as_markdown(self) -> str:
        """For a README."""
        heading, *rows = [[in_markdown(cell) for cell in row] for row in (self.heading, *self.rows)]
        notes = [f"{in_markdown(note)}\n" for note in self.notes]
        return "\n".join([f"**{in_markdown(self.title)}**", "", markdown_table(heading, rows), "", *notes])

    def as_latex(self) -> str:
        """A ``table`` environment that needs no package."""
        body = [" & ".join(map(in_latex, row)) + r" \\" for row in (self.heading, *self.rows)]
        return "\n".join(
            [
                r"\begin{table}",
                rf"\caption{{{in_latex(' '.join([f'{self.title}.', *self.notes]))}}}",
                rf"\begin{{tabular}}{{{'l' * len(self.heading)}}}",
                r"\hline",
                body[0],
                r"\hline",
                *body[1:],
                r"\hline",
                r"\end{tabular}",
                r"\end{table}",
                "",
            ]
        )

    def as_figure(self) -> Figure:
        """For slides."""
        figure = Figure(figsize=(1, 1))
        axes = figure.subplots()
        axes.set_axis_off()
        rows = [[in_figure(cell) for cell in row] for row in self.rows[:MOST_DRAWN]]
        if more := len(self.rows) - len(rows):
            rows.append([f"and {more} more rows", *[""] * (len(self.heading) - 1)])
        heading = [in_figure(text) for text in self.heading]
        drawn = axes.table(rows, colLabels=heading, cellLoc="left", loc="center")
        drawn.auto_set_font_size(False)
        drawn.set_fontsize(9)
        drawn.auto_set_column_width(list(range(len(self.heading))))
        for (row, _), cell in drawn.get_celld().items():
            cell.set_height(0.24)  # inches, the axes being about one high
            cell.set_edgecolor("#b0b0b0")
            if row == 0:
                cell.set_text_props(weight="bold")
        axes.set_title(in_figure(self.title), fontsize=10, y=0.56 + 0.12 * (len(rows) + 1), loc="center")
        return figure


@dataclass(frozen=True)
class DocumentedTable:
    """One measured table of a page.

    Attributes:
        heading: one text for each column.
        rows: as many cells each. Texts are Markdown.
        provenance: of the figures.
        notes: sentences below the table.
    """

    heading: list[str]
    rows: list[list[str]]
    provenance: Provenance
    notes: list[str] = field(default_factory=list)

    def as_markdown(self) -> str:
        """Return the table, its notes and its provenance; columns of figures are aligned to the right."""
        right = [place for place in range(len(self.heading)) if all(_is_figure(row[place]) for row in self.rows)]
        notes = [f"{note}\n" for note in self.notes]
        lines = [markdown_table(self.heading, self.rows, right), "", *notes, f"*{self.provenance.sentence()}*"]
        return "\n".join(lines) + "\n"


def _is_figure(cell: str) -> bool:
    return re.fullmatch(r"[-+±.,%/() \d]*|\*\*[-+±.,%/() \d]*\*\*", cell) is not None
