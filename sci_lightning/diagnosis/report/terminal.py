"""What a diagnosis shows on the terminal: how the search goes, and what it found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.diagnosis.report.digits import chi2
from sci_lightning.diagnosis.report.sentences import parameter

TONES = {"consistent": "green", "explained": "green", "partly_explained": "yellow", "unexplained": "red"}


@contextmanager
def searching(console: PlainConsole, most: int) -> Iterator[Callable[[str], None]]:
    """A bar over the rounds of the search; gives what is to be called with every piece of news.

    Args:
        console: where to.
        most: rounds at most.
    """
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("searching, round 1", total=most + 1)

        def told(news: str) -> None:
            progress.console.print(f"  {news}", style="dim")
            progress.advance(task)
            progress.update(task, description=f"searching, round {int(progress.tasks[0].completed) + 1}")

        yield told


def print_report(report: Mapping[str, Any], sentence: str, console: PlainConsole) -> None:
    """Verdict, effects with their parameters, and the gap before and after.

    Args:
        report: ``report.json``.
        sentence: the verdict in words.
        console: where to.
    """
    verdict = report["verdict"]
    console.say(styled(verdict.replace("_", " "), f"bold {TONES[verdict]}"), f": {sentence}")
    if report["effects"]:
        effects = Table("effect", "stage", "parameter", title="effects", title_justify="left")
        effects.add_column("value", justify="right")
        for effect in report["effects"]:
            for name, content in effect["parameters"].items():
                unit = "" if content["unit"] == "1" else f" {content['unit']}"
                effects.add_row(effect["name"], effect["stage"], name, parameter(content) + unit)
        console.print(effects)
        console.say("\u00b1 is one standard deviation, statistical only; report.json has all digits")
    before, after = report["gap"]["before"], report["gap"]["after"]
    gap = Table("kind", title="gap on held-out pixels", title_justify="left")
    for title in ("RMSE before (DN)", "after", "chi2 before", "after"):
        gap.add_column(title, justify="right")
    for kind in (*before["by_kind"], "all"):
        pair = [each if kind == "all" else each["by_kind"][kind] for each in (before, after)]
        numbers = (*(f"{each['rmse_dn']:.3g}" for each in pair), *(chi2(each["chi2"]) for each in pair))
        gap.add_row(kind, *numbers, style="bold" if kind == "all" else "")
    console.print(gap)
    for advice in report["next_captures"]:
        console.say(styled("record next"), f": {advice}")
