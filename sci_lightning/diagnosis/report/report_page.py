"""``report.html``: a diagnosis on one page that needs no other file.

This module chooses what every page shows, ``sections.py`` the numbers and figures that belong to known or to unknown
scenes; ``report_page.html`` beside it is the Jinja2 template with all markup and all fixed texts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis, BlindEffect
from sci_lightning.diagnosis.report.sections import sections_of_known_scenes, sections_of_unknown_scenes
from sci_lightning.diagnosis.report.sentences import (
    UNCERTAINTY,
    clause,
    considered,
    headline,
    percentage,
    quantity,
    uncertainty,
)
from sci_lightning.diagnosis.report.svg import svg
from sci_lightning.diagnosis.result import CalibratedResult
from sci_lightning.plain_text import printable
from sci_lightning.runs.provenance import installed_version

WIDE_INCHES = 7.0
"""Width from which a figure is scrolled on a narrow page, because it would become illegible."""
EFFECT_COLUMNS = (
    "effect",
    "stage",
    "probability",
    "parameter",
    "value",
    "error (1 σ)",
    "unit",
    "nats lost without it",
    "snapshots that support it",
)
"""Titles of the table of what was found; what stands in none of its rows is left out."""
VERDICTS = {
    "consistent": "consistent: nothing is missing",
    "explained": "explained",
    "partly_explained": "partly explained",
    "undecided": "undecided",
    "unexplained": "unexplained",
}


@dataclass(frozen=True)
class ReportProvenance:
    """What was diagnosed, when and how; what is empty or None is not stated.

    Attributes:
        file: name of the captures file, without its folder.
        name: what the file calls the camera or the session.
        date: ISO 8601, UTC.
        runtime_s: seconds from the captures to the figures.
        command: the command that was run.
    """

    file: str = ""
    name: str = ""
    date: str = ""
    runtime_s: float | None = None
    command: str = ""

    def describe(self) -> dict[str, Any]:
        """Return what ``report.json`` says about this, as plain data."""
        captures = {"captures": {"file": self.file, "name": self.name}} if self.file or self.name else {}
        date = {"date": self.date} if self.date else {}
        return captures | date | ({} if self.runtime_s is None else {"runtime_s": self.runtime_s})


def report_page(
    result: CalibratedResult | BlindDiagnosis, provenance: ReportProvenance, drawn: Mapping[str, Figure]
) -> str:
    """Return the page as HTML with all figures in it.

    Args:
        result: of the diagnosis.
        provenance: what was diagnosed, when and how.
        drawn: :func:`~sci_lightning.diagnosis.report.pictures.figures` of the diagnosis.
    """
    if isinstance(result, BlindDiagnosis):
        sections = sections_of_unknown_scenes(result)
    else:
        sections = sections_of_known_scenes(result)
    return (
        environment()
        .get_template("report_page.html")
        .render(
            **sections,
            blind=result.mode == "blind",
            result=result,
            drawn=drawn,
            title=_title(result, provenance),
            verdict_words=VERDICTS[result.verdict],
            headline=headline(result),
            source=_source(provenance),
            clauses=[clause(effect) for effect in result.effects],
            effect_table=without_empty_columns(EFFECT_COLUMNS, _effect_rows(result)),
            uncertainty=UNCERTAINTY[result.mode],
            ambiguous=[effect for effect in result.effects if effect.alternatives],
            footer=_footer(result, provenance, sections["about_pixels"]),
        )
    )


def environment() -> Environment:
    """Return Jinja2's environment: every text is escaped and has no control characters, whoever contributes it."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: printable(value) if type(value) is str else value,
    )
    environment.filters |= {"typeset": _typeset, "p_value": _p_value}
    environment.globals |= {"svg": _svg, "is_wide": lambda figure: figure.get_size_inches()[0] > WIDE_INCHES}
    return environment


def _svg(figure: Figure, label: str) -> Markup:
    return Markup(svg(figure, label))


def _typeset(text: str) -> str:
    """Return a text with chi squared and minus as they are printed."""
    return re.sub(r"(?<![\w.])-(?=\d)", "\u2212", text.replace("chi2", "χ²"))


def _p_value(value: float) -> str:
    return "< 1e-300" if value < 1e-300 else f"{value:.2g}"


def _title(result: CalibratedResult | BlindDiagnosis, provenance: ReportProvenance) -> str:
    effects = f"{VERDICTS[result.verdict]}: {', '.join(result.names) or 'no effect'}"
    return " \u00b7 ".join(filter(None, (effects, provenance.file, provenance.date[:10])))


def _source(provenance: ReportProvenance) -> str:
    """Return which file was diagnosed, what it calls itself, and when."""
    name = provenance.name if provenance.name != Path(provenance.file).stem else ""
    date = provenance.date[:16].replace("T", " ")
    return " \u00b7 ".join(filter(None, (provenance.file, name, date and f"{date} UTC")))


def without_empty_columns(
    columns: Sequence[str], rows: Sequence[Sequence[str]]
) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return the titles and the rows of a table without the columns in which no row says anything."""
    kept = [place for place, _ in enumerate(columns) if any(row[place] for row in rows)]
    return [columns[place] for place in kept], [tuple(row[place] for place in kept) for row in rows]


def _effect_rows(result: CalibratedResult | BlindDiagnosis) -> list[tuple[str, ...]]:
    """Return the columns of every parameter's row; what is as in the row above is empty."""
    rows: list[tuple[str, ...]] = []
    for effect in result.effects:
        first = effect.name, effect.effect.stage, percentage(effect.probability)
        evidence = "" if effect.delta_nll is None else f"{effect.delta_nll:,.0f}"
        agree = f"{effect.agree} of {effect.snapshots}" if isinstance(effect, BlindEffect) else ""
        for name, estimate in effect.parameters.items():
            value = quantity(estimate.value, estimate.std).split(" ")[0]
            error = uncertainty(estimate.std)
            unit = "" if estimate.unit == "1" else estimate.unit
            rows.append((*first, name, value, error and f"\u00b1 {error}", unit, evidence, agree))
            first, evidence, agree = ("", "", ""), "", ""
    return rows


def _footer(
    result: CalibratedResult | BlindDiagnosis, provenance: ReportProvenance, about_pixels: Mapping[str, str]
) -> dict[str, str]:
    """Return the rows of the table on how the page was made, by title; what nothing is known of is left out."""
    rows = {**about_pixels, "effects": considered(result.considered), "command": provenance.command}
    rows["run time"] = "" if provenance.runtime_s is None else f"{provenance.runtime_s:.1f} s"
    rows["version"] = f"sci_lightning {installed_version()}, seed {result.seed}"
    return {title: content for title, content in rows.items() if content}
