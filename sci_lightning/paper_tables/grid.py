"""A table of text: on the terminal, as Markdown, LaTeX and PNG."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure
from rich import box
from rich.table import Table

from sci_lightning.atomic_file import whole_file
from sci_lightning.figures import write_figure

LATEX = {"\\": r"\textbackslash{}", "±": r"$\pm$", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}


@dataclass(frozen=True)
class Grid:
    """A heading over rows of cells.

    Attributes:
        name: of the files.
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

    def write(self, folder: Path) -> list[Path]:
        """Write NAME.md, NAME.tex and NAME.png; returns their paths."""
        texts = {"md": self.as_markdown(), "tex": self.as_latex()}
        for ending, text in texts.items():
            with whole_file(folder / f"{self.name}.{ending}") as temporary:
                temporary.write_text(text, encoding="utf-8")
        write_figure(self.as_figure(), folder / f"{self.name}.png")
        return [folder / f"{self.name}.{ending}" for ending in (*texts, "png")]

    def as_table(self) -> Table:
        """For the terminal."""
        caption = "\n".join(self.notes) or None
        table = Table(title=self.title, title_justify="left", caption=caption, caption_justify="left", box=box.SIMPLE)
        for text in self.heading:
            table.add_column(text)
        for row in self.rows:
            table.add_row(*row)
        return table

    def as_markdown(self) -> str:
        """For a README."""
        ruled = [self.heading, ["---"] * len(self.heading), *self.rows]
        lines = [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in ruled]
        return "\n".join([f"**{self.title}**", "", *lines, "", *(f"{note}\n" for note in self.notes)])

    def as_latex(self) -> str:
        """A ``table`` environment that needs no package."""
        body = [" & ".join(map(escaped, row)) + r" \\" for row in (self.heading, *self.rows)]
        return "\n".join(
            [
                r"\begin{table}",
                rf"\caption{{{escaped(' '.join([f'{self.title}.', *self.notes]))}}}",
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
        drawn = axes.table(self.rows, colLabels=self.heading, cellLoc="left", loc="center")
        drawn.auto_set_font_size(False)
        drawn.set_fontsize(9)
        drawn.auto_set_column_width(list(range(len(self.heading))))
        for (row, _), cell in drawn.get_celld().items():
            cell.set_height(0.24)  # inches, the axes being about one high
            cell.set_edgecolor("#b0b0b0")
            if row == 0:
                cell.set_text_props(weight="bold")
        axes.set_title(self.title, fontsize=10, y=0.56 + 0.12 * (len(self.rows) + 1), loc="center")
        return figure


def escaped(text: str) -> str:
    """Text with what LaTeX would take for commands made into the signs they are."""
    return re.sub(r"[\\±~^&%$#_{}]", lambda sign: LATEX.get(sign[0], f"\\{sign[0]}"), text)
