"""A diagnosis on the terminal: how the search proceeds, and its result."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from sci_lightning.console import PlainConsole, styled
from sci_lightning.diagnosis.report.digits import chi2, quantity
from sci_lightning.diagnosis.report.sentences import considered, headline
from sci_lightning.diagnosis.result import Result

COLOURS = {"consistent": "green", "explained": "green", "partly_explained": "yellow", "unexplained": "red"}


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


def print_report(diagnosis: Result, console: PlainConsole) -> None:
    """Print the verdict, the named effects with their parameters, and the gap before and after."""
    verdict = diagnosis.verdict
    console.say(styled(verdict.replace("_", " "), f"bold {COLOURS[verdict]}"), f": {headline(diagnosis)}")
    if diagnosis.effects:
        effects = Table("effect", "stage", "parameter", title="effects", title_justify="left")
        effects.add_column("value", justify="right")
        for effect in diagnosis.effects:
            for name, estimate in effect.parameters.items():
                value = quantity(estimate.value, estimate.std, estimate.systematic)
                unit = "" if estimate.unit == "1" else f" {estimate.unit}"
                effects.add_row(effect.name, effect.effect.stage, name, value + unit)
        console.print(effects)
        console.say("\u00b1 is one standard deviation, statistical only; report.json has all digits")
    before, after = diagnosis.before.gap, diagnosis.after.gap
    gap = Table("kind", title="gap on held-out pixels", title_justify="left")
    for title in ("RMSE before (DN)", "after", "chi2 before", "after"):
        gap.add_column(title, justify="right")
    for kind in (*before.by_kind, "all"):
        pair = [whole if kind == "all" else whole.by_kind[kind] for whole in (before, after)]
        numbers = (*(f"{misfit.rmse_dn:.3g}" for misfit in pair), *(chi2(misfit.chi2) for misfit in pair))
        gap.add_row(kind, *numbers, style="bold" if kind == "all" else "")
    console.print(gap)
    if (verification := diagnosis.verification) is not None:
        reached = f"chi2 {chi2(verification.before.chi2)} before, {chi2(verification.after.chi2)} after"
        count = len(verification.captures)
        console.say(
            f"on {count} capture{'s' * (count > 1)} that nothing has seen: {reached}; the verdict rests on this"
        )
    if diagnosis.unknown_scenes is not None:
        console.say(diagnosis.unknown_scenes.sentence())
    for capture in diagnosis.bad_captures:
        console.say(styled("left out", "yellow"), f": {capture.sentence}")
    split = diagnosis.split.describe()
    if any(split["border"].values()):
        console.say(
            f"what lies beyond the patterns is unknown: {100 * split['counted_fraction']:.0f} % of the pixels do not "
            "depend on it and count"
        )
    console.say(considered(diagnosis.considered))
    for advice in diagnosis.next_captures:
        console.say(styled("record next"), f": {advice}")
