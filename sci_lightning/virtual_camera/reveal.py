"""``python -m sci_lightning.virtual_camera.reveal TRUTH REPORT``: what was hidden, beside what was found."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.table import Table

from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.cli.next_command import invocation, print_next
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import one_printable_line
from sci_lightning.virtual_camera.comparison import Estimate, compare, verdict
from sci_lightning.virtual_camera.hardware.parameter import Value
from sci_lightning.virtual_camera.reveal_files import read_report, read_truth

GOOD_ANSWERS = ("within 95 %", "right")


def reveal(truth: str, report: str) -> None:
    """Print a table of the parameters, true and estimated, and a verdict in one sentence.

    Args:
        truth: ``<captures>.truth.json`` of a virtual camera.
        report: ``report.json`` of a diagnosis of its captures.

    Raises:
        BadInput: a file that is missing, or is something else.
    """
    hidden, reported = read_truth(truth), read_report(report)
    table = Table(title="what was hidden, and what was found", title_justify="left")
    for name in ("effect", "parameter", "hidden", "found", ""):
        table.add_column(name, justify="right" if name in ("hidden", "found") else "left", no_wrap=name != "parameter")
    for row in compare(hidden, reported):
        parameter = f"{row.parameter} ({row.unit})" if row.unit not in ("", "1") else row.parameter
        answer = styled(row.answer, "green" if row.answer in GOOD_ANSWERS else "red")
        table.add_row(row.effect, parameter, _value_text(row.truth), _estimate_text(row.estimate), answer)
    console = PlainConsole()
    if table.row_count:
        console.print(table)
    sentence = verdict(hidden, reported)
    chi2 = f"held-out chi2 {reported.chi2_before:.4g} before, {reported.chi2_after:.4g} after"
    console.say(styled(sentence), f"; {chi2}")
    encoder = Path(report).parent / "encoder.yaml"
    if encoder.is_file():
        print_next(console, invocation("train", "experiment=quickstart", paths={"encoder": encoder}))


def main() -> None:
    """Run the command line; bad input prints one line on standard error and exits with status 2."""
    if len(sys.argv) != 3 or sys.argv[1].startswith("-"):
        print(__doc__)
        sys.exit(0 if "--help" in sys.argv else 2)
    try:
        reveal(sys.argv[1], sys.argv[2])
    except BadInput as error:
        print(f"error: {one_printable_line(str(error))}", file=sys.stderr)
        sys.exit(2)


def _value_text(value: Value | None) -> str:
    if value is None:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _estimate_text(estimate: Estimate | None) -> str:
    if estimate is None:
        return ""
    return _value_text(estimate.value) + (f" ± {estimate.std:.2g}" if estimate.std else "")


if __name__ == "__main__":
    main()
