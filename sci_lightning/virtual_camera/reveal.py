"""``python -m sci_lightning.virtual_camera.reveal TRUTH REPORT``: what was hidden, beside what was found."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.table import Table

from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.cli.next_command import invocation, print_next
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import one_printable_line
from sci_lightning.virtual_camera.answer_files import read_report, read_truth
from sci_lightning.virtual_camera.comparison import Compared, compare, verdict
from sci_lightning.virtual_camera.hardware.parameter import Value


def reveal(truth: str, report: str) -> None:
    """Print a table, parameter by parameter, and the verdict in a sentence.

    Args:
        truth: ``<captures>.truth.json`` of a virtual camera. report: ``report.json`` of a diagnosis of its captures.

    Raises:
        BadInput: a file that is missing, or is something else.
    """
    hidden, found = read_truth(truth), read_report(report)
    table = Table(title="what was hidden, and what was found", title_justify="left")
    for name in ("effect", "parameter", "hidden", "found", ""):
        table.add_column(name, justify="right" if name in ("hidden", "found") else "left", no_wrap=name != "parameter")
    colours = {"within 95 %": "green", "right": "green"}
    for row in compare(hidden, found):
        colour = colours.get(row.answer, "red")
        unit = f"{row.parameter} ({row.unit})" if row.unit not in ("", "1") else row.parameter
        table.add_row(row.effect, unit, _number(row.truth), _found(row), styled(row.answer, colour))
    console = PlainConsole()
    if table.row_count:
        console.print(table)
    chi2 = [f"{found['gap'][when]['chi2']:.4g}" for when in ("before", "after")]
    console.say(styled(verdict(hidden, found)), f"; held-out chi2 {chi2[0]} before, {chi2[1]} after")
    encoder = Path(report).parent / "encoder.yaml"
    if encoder.is_file():
        print_next(console, invocation("train", "experiment=quickstart", paths={"encoder": encoder}))


def main() -> None:
    """The command line: one line on stderr and status 2 on bad input."""
    if len(sys.argv) != 3 or sys.argv[1].startswith("-"):
        print(__doc__)
        sys.exit(0 if "--help" in sys.argv else 2)
    try:
        reveal(sys.argv[1], sys.argv[2])
    except BadInput as error:
        print(f"error: {one_printable_line(str(error))}", file=sys.stderr)
        sys.exit(2)


def _number(value: Value | None) -> str:
    return "" if value is None else f"{value:.5g}" if isinstance(value, float) else str(value)


def _found(row: Compared) -> str:
    return _number(row.found) + (f" ± {row.std:.2g}" if row.std else "")


if __name__ == "__main__":
    main()
