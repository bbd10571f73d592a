"""A diagnosis on the terminal: how the search proceeds, and its result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from sci_lightning.console import PlainConsole, styled
from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
from sci_lightning.diagnosis.blind.undetermined import SHOWN_IF_STRONG
from sci_lightning.diagnosis.report.sentences import (
    chi2,
    considered,
    count_of,
    further_notes,
    headline,
    laboratory,
    not_named,
    not_tried,
    percentage,
    quantity,
)
from sci_lightning.diagnosis.result import CalibratedResult

COLOURS = {
    "consistent": "green",
    "explained": "green",
    "partly_explained": "yellow",
    "undecided": "yellow",
    "unexplained": "red",
}


@contextmanager
def search_progress(console: PlainConsole, rounds: int) -> Iterator[Callable[[str], None]]:
    """Show a progress bar over the rounds of the search.

    Args:
        console: the terminal.
        rounds: largest number of rounds.

    Yields:
        A function to be called with a one-line message after every step.
    """
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("searching, round 1", total=rounds + 1)

        def on_progress(message: str) -> None:
            progress.console.print(f"  {message}", style="dim")
            progress.advance(task)
            progress.update(task, description=f"searching, round {int(progress.tasks[0].completed) + 1}")

        yield on_progress


def print_report(result: CalibratedResult | BlindDiagnosis, console: PlainConsole) -> None:
    """Print the verdict, the named effects with their parameters, how far it was confirmed, and what is left open."""
    verdict = styled(result.verdict.replace("_", " "), f"bold {COLOURS[result.verdict]}")
    of_unknown_scenes = isinstance(result, BlindDiagnosis)
    console.say(verdict, " (scenes unknown)" if of_unknown_scenes else "", f": {headline(result)}")
    if result.effects:
        effects = Table("effect", "stage", "parameter", title="effects", title_justify="left")
        effects.add_column("value", justify="right")
        effects.add_column("probability", justify="right")
        for effect in result.effects:
            probability = percentage(effect.probability)
            for name, estimate in effect.parameters.items():
                value = quantity(estimate.value, estimate.std)
                unit = "" if estimate.unit == "1" else f" {estimate.unit}"
                effects.add_row(effect.name, effect.effect.stage, name, value + unit, probability)
                probability = ""
        console.print(effects)
        console.say("\u00b1 is one standard deviation; report.json has all digits")
    if isinstance(result, BlindDiagnosis):
        _print_snapshots(result, console)
    else:
        _print_captures(result, console)
    if isinstance(result, CalibratedResult) and result.imperfections:
        console.say(f"{laboratory(result)}.")
    console.say(considered(result.considered))
    for advice in result.next_captures:
        console.say(styled("record next"), f": {advice}")


def _print_captures(result: CalibratedResult, console: PlainConsole) -> None:
    """Print the gap before and after, and which captures and pixels count nowhere."""
    before, after = result.before.gap, result.after.gap
    gap = Table("kind", title="gap on held-out pixels", title_justify="left")
    for title in ("RMSE before (DN)", "after", "chi2 before", "after"):
        gap.add_column(title, justify="right")
    for kind in (*before.by_kind, "all"):
        pair = [whole if kind == "all" else whole.by_kind[kind] for whole in (before, after)]
        numbers = (*(f"{misfit.rmse_dn:.3g}" for misfit in pair), *(chi2(misfit.chi2) for misfit in pair))
        gap.add_row(kind, *numbers, style="bold" if kind == "all" else "")
    console.print(gap)
    if (verification := result.verification) is not None:
        reached = f"chi2 {chi2(verification.before.chi2)} before, {chi2(verification.after.chi2)} after"
        count = count_of(len(verification.captures), "capture")
        console.say(f"on {count} that nothing has seen: {reached}; the verdict rests on this")
    if result.unknown_scenes is not None:
        console.say(result.unknown_scenes.sentence())
    if doubtful := not_named(result):
        console.say(styled("not named", "yellow"), f", with their probabilities: {doubtful}")
    if result.budget.not_tried:
        console.say(styled("not tried", "yellow"), f": {not_tried(result)}")
    for capture in result.bad_captures:
        console.say(styled("left out", "yellow"), f": {capture.sentence}")
    split = result.split.describe()
    if any(split["border"].values()):
        console.say(
            f"what lies beyond the patterns is unknown: {100 * split['counted_fraction']:.0f} % of the pixels do not "
            "depend on it and count"
        )


def _print_snapshots(result: BlindDiagnosis, console: PlainConsole) -> None:
    """Print how many snapshots support every effect and the whole camera, and what they leave undetermined."""
    for effect in result.effects:
        console.say(
            f"{effect.name}: {effect.agree} of {count_of(effect.snapshots, 'snapshot')} support it, "
            f"{effect.delta_nll or 0:,.0f} calibrated nats, p = {effect.p_value:.2g}"
        )
    if result.prediction is not None and result.effects:
        gap = result.prediction.gap
        console.say(
            f"held-out pixels: prediction error {gap.before:.3g} before, {gap.after:.3g} after; {gap.agree} of "
            f"{count_of(gap.snapshots, 'snapshot')} support it, p = {gap.p_value:.2g}"
        )
    for note in further_notes(result):
        console.say(note)
    hidden = [f"a weak {name}" if name in SHOWN_IF_STRONG else name for name in result.undetermined]
    console.say(f"unknown scenes cannot tell: {', '.join(hidden)}; report.json says why")
