"""``python -m sci_lightning.virtual_camera.reveal``: what was hidden, beside what was found."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from sci_lightning.cli.command import run
from sci_lightning.cli.command_line import with_keys
from sci_lightning.cli.composition import Composition
from sci_lightning.cli.next_command import invocation, print_next
from sci_lightning.cli.settings import CommandSettings
from sci_lightning.configuration.bounds import ExistingPath
from sci_lightning.console import PlainConsole, styled
from sci_lightning.files.diagnosis_report import Estimate
from sci_lightning.files.json_file import read_json
from sci_lightning.virtual_camera.comparison import compare, read_report, verdict
from sci_lightning.virtual_camera.hardware.effect import Value
from sci_lightning.virtual_camera.truth import Truth

GOOD_ANSWERS = ("within 95 %", "right", "true as well")


@dataclass(frozen=True)
class RevealSettings(CommandSettings):
    truth: ExistingPath
    report: ExistingPath


def reveal(composition: Composition) -> None:
    """Print a table of the parameters, true and estimated, and a verdict in one sentence.

    Raises:
        BadInput: a file that is missing, or is something else.
    """
    cfg = composition.cfg
    truth, reported = read_json(cfg.truth, Truth), read_report(cfg.report)
    hidden, also_true = truth.effects, truth.also_true
    table = Table(title="what was hidden, and what was found", title_justify="left")
    for name in ("effect", "parameter", "hidden", "found", ""):
        table.add_column(name, justify="right" if name in ("hidden", "found") else "left", no_wrap=name != "parameter")
    for row in compare(hidden, reported, also_true):
        parameter = f"{row.parameter} ({row.unit})" if row.unit not in ("", "1") else row.parameter
        answer = styled(row.answer, "green" if row.answer in GOOD_ANSWERS else "red")
        table.add_row(row.effect, parameter, _value_text(row.truth), _estimate_text(row.estimate), answer)
    console = PlainConsole()
    if table.row_count:
        console.print(table)
    sentence = verdict(hidden, reported, also_true)
    chi2 = f"held-out chi2 {reported.chi2_before:.4g} before, {reported.chi2_after:.4g} after"
    console.say(styled(sentence), f"; {chi2}")
    encoder = Path(cfg.report).parent / "encoder.yaml"
    if encoder.is_file():
        print_next(console, invocation("train", "experiment=quickstart", paths={"encoder": encoder}))


def _value_text(value: Value | None) -> str:
    if value is None:
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _estimate_text(estimate: Estimate | None) -> str:
    if estimate is None:
        return ""
    return _value_text(estimate.value) + (f" ± {estimate.std:.2g}" if estimate.std else "")


def main() -> None:
    """Run the command."""
    sys.argv[1:] = with_keys(sys.argv[1:], ["truth", "report"])
    run("reveal", reveal)
