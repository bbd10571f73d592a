"""``report.html``: a diagnosis on one page that needs no other file.

This module chooses the numbers and figures and rounds them; ``report_page.html`` beside it is the Jinja2 template with
all markup and all fixed texts.
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

from sci_lightning.diagnosis.fit.gap import Misfit
from sci_lightning.diagnosis.model.camera_model import datasheet_noise
from sci_lightning.diagnosis.report import pictures
from sci_lightning.diagnosis.report.digits import chi2, quantity, uncertainty
from sci_lightning.diagnosis.report.sentences import clause, considered, fallen, headline, nats_gained
from sci_lightning.diagnosis.report.svg import svg
from sci_lightning.diagnosis.residual_tests import ResidualTest
from sci_lightning.diagnosis.result import Result
from sci_lightning.diagnosis.verdict import NEGLIGIBLE
from sci_lightning.plain_text import printable
from sci_lightning.version import installed_version

MAX_TEST_FIGURES = 8
"""Residual tests that are drawn."""
WIDE = 7.0
"""Width in inches from which a figure is scrolled on a narrow page, because it would become illegible."""
EFFECT_COLUMNS = (
    "effect",
    "stage",
    "parameter",
    "value",
    "statistical error (1 σ)",
    "unit",
    "nats lost without it",
)
VERDICTS = {
    "consistent": "consistent: nothing is missing",
    "explained": "explained",
    "partly_explained": "partly explained",
    "unexplained": "unexplained",
}


@dataclass(frozen=True)
class Provenance:
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


@dataclass(frozen=True)
class Card:
    """A figure at the head of the page.

    Attributes:
        value: the figure itself, as it is shown.
        label: what it is.
    """

    value: str
    label: str


def report_page(
    diagnosis: Result, provenance: Provenance, drawn: Mapping[str, Figure], uncertainty_note: str = ""
) -> str:
    """Return the page as HTML with all figures in it.

    Args:
        diagnosis: the result.
        provenance: what was diagnosed, when and how.
        drawn: :func:`~sci_lightning.diagnosis.report.pictures.figures` of the diagnosis.
        uncertainty_note: what the uncertainties mean, for people.
    """
    correlation, trade_offs = diagnosis.correlation, None
    if len(correlation.names) > 2:
        trade_offs = pictures.correlation_figure(list(correlation.names), correlation.matrix)
    significant = _significant_tests(diagnosis)
    drawn_tests = significant[:MAX_TEST_FIGURES]
    return (
        environment()
        .get_template("report_page.html")
        .render(
            diagnosis=diagnosis,
            drawn=drawn,
            title=_title(diagnosis, provenance),
            verdict_words=VERDICTS[diagnosis.verdict],
            headline=headline(diagnosis),
            source=_source(provenance),
            captures=_captures(diagnosis),
            cards=_cards(diagnosis),
            clauses=[clause(effect) for effect in diagnosis.effects],
            effect_table=without_empty_columns(EFFECT_COLUMNS, _effect_rows(diagnosis)),
            afterwards=_named_afterwards(diagnosis),
            uncertainty=uncertainty_note,
            correlation=correlation,
            correlation_figure=trade_offs,
            gap_rows=_gap_rows(diagnosis),
            significance=f"{diagnosis.settings.significance:g}",
            tolerated=sum(test.significant for test in diagnosis.after.tests) - len(diagnosis.remaining),
            tests=_test_pairs(diagnosis),
            significant_tests=len(significant),
            test_figures=[(after.question, pictures.test_figure(before, after)) for before, after in drawn_tests],
            ambiguous=[effect for effect in diagnosis.effects if effect.alternatives],
            maps=_maps(diagnosis),
            footer=_footer(diagnosis, provenance),
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
    environment.globals |= {"svg": _svg, "is_wide": lambda figure: figure.get_size_inches()[0] > WIDE}
    return environment


def _svg(figure: Figure, label: str) -> Markup:
    return Markup(svg(figure, label))


def _typeset(text: str) -> str:
    """Return a text with chi squared and minus as they are printed."""
    return re.sub(r"(?<![\w.])-(?=\d)", "\u2212", text.replace("chi2", "χ²"))


def _p_value(value: float) -> str:
    return "< 1e-300" if value < 1e-300 else f"{value:.2g}"


def _title(diagnosis: Result, provenance: Provenance) -> str:
    effects = f"{VERDICTS[diagnosis.verdict]}: {', '.join(diagnosis.names) or 'no effect'}"
    return " \u00b7 ".join(filter(None, (effects, provenance.file, provenance.date[:10])))


def _source(provenance: Provenance) -> str:
    """Return which file was diagnosed, what it calls itself, and when."""
    name = provenance.name if provenance.name != Path(provenance.file).stem else ""
    date = provenance.date[:16].replace("T", " ")
    return " \u00b7 ".join(filter(None, (provenance.file, name, date and f"{date} UTC")))


def _captures(diagnosis: Result) -> str:
    observation = diagnosis.observation
    height, width = observation.size
    kinds = ", ".join(f"{observation.kinds.count(kind)} {kind}" for kind in sorted(set(observation.kinds)))
    judged = "judged on pixels that no fit has seen" if diagnosis.split.held_out.any() else "nothing could be held out"
    return (
        f"{len(observation)} captures with known scenes ({kinds}), {height} \u00d7 {width} pixels, "
        f"{observation.frames} slots, {observation.bit_depth} bits; {judged}."
    )


def _cards(diagnosis: Result) -> list[Card]:
    """Return the figures at the head of the page: first the one that fell, as in the headline; else chi2."""
    before, after = diagnosis.before.gap, diagnosis.after.gap
    limit = f"; chance reaches {chi2(after.chi2_limit)} with {after.pixels:,} pixels"
    count, questions = len(diagnosis.effects), [test.significant for test in diagnosis.before.tests]
    chi2_label = f"held-out reduced χ² (1 = noise{limit if after.chi2_limit > NEGLIGIBLE else ''})"
    cards = {
        "chi2": Card(_change(chi2(before.chi2), chi2(after.chi2)), chi2_label),
        "rmse_dn": Card(f"{_change(f'{before.rmse_dn:.3g}', f'{after.rmse_dn:.3g}')} DN", "held-out RMS error"),
    }
    figure = fallen(before, after)
    if figure == "nll":
        likelier = Card(f"{nats_gained(before, after):,.0f} nats", "by which held-out pixels become likelier")
        cards = {"nll": likelier, **cards}
    first = [cards.pop(figure)] if figure else []
    return [
        *first,
        *cards.values(),
        Card(
            _change(str(sum(questions)), str(len(diagnosis.remaining))),
            f"of {len(questions)} questions find more than noise",
        ),
        Card(str(count), f"effect{'s' * (count != 1)} named"),
    ]


def _change(before: str, after: str) -> str:
    """Return two figures with an arrow between them; one of them where nothing changes."""
    return after if before == after else f"{before} \u2192 {after}"


def without_empty_columns(
    columns: Sequence[str], rows: Sequence[Sequence[str]]
) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return the titles and the rows of a table without the columns in which no row says anything."""
    kept = [place for place, _ in enumerate(columns) if any(row[place] for row in rows)]
    return [columns[place] for place in kept], [tuple(row[place] for place in kept) for row in rows]


def _effect_rows(diagnosis: Result) -> list[tuple[str, ...]]:
    """Return effect, stage, parameter, value, error, unit and evidence; what is as in the row above is empty."""
    rows: list[tuple[str, ...]] = []
    for effect in diagnosis.effects:
        first = effect.name, effect.effect.stage
        evidence = "" if effect.delta_nll is None else f"{effect.delta_nll:,.0f}"
        for name, estimate in effect.parameters.items():
            value = quantity(estimate.value, estimate.std, estimate.systematic).split(" ")[0]
            error = uncertainty(estimate.std)
            unit = "" if estimate.unit == "1" else estimate.unit
            rows.append((*first, name, value, error and f"\u00b1 {error}", unit, evidence))
            first, evidence = ("", ""), ""
    return rows


def _named_afterwards(diagnosis: Result) -> dict[str, str]:
    """Return the named effects that no round of the search has added, and how they came to be named."""
    added = {considered.added for considered in diagnosis.rounds}
    return {
        effect.name: "every model has it, so that it is no candidate; its values are judged after the last round"
        if effect.effect.noise
        else "it took the place of one that a round had added, because it fits better beside the others"
        for effect in diagnosis.effects
        if effect.name not in added
    }


def _gap_rows(diagnosis: Result) -> list[tuple[str, ...]]:
    """Return the misfit before and after of every kind of capture and of all."""

    def row(kind: str, before: Misfit, after: Misfit) -> tuple[str, ...]:
        rmse = _change(_three_digits(before.rmse_dn), _three_digits(after.rmse_dn))
        nll = _change(_three_digits(before.nll), _three_digits(after.nll))
        return kind, rmse, _change(chi2(before.chi2), chi2(after.chi2)), nll

    before, after = diagnosis.before.gap, diagnosis.after.gap
    rows = [row(kind, misfit, after.by_kind[kind]) for kind, misfit in before.by_kind.items()]
    return [*rows, row("all", before, after)]


def _three_digits(value: float) -> str:
    """Return three significant digits, without an exponent."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _test_pairs(diagnosis: Result) -> list[tuple[ResidualTest | None, ResidualTest]]:
    """Return every residual test before and after; None where it could not be made before."""
    before = {test.name: test for test in diagnosis.before.tests}
    return [(before.get(test.name), test) for test in diagnosis.after.tests]


def _significant_tests(diagnosis: Result) -> list[tuple[ResidualTest | None, ResidualTest]]:
    """Return the pairs that find something: what is left first, variance last, otherwise the largest first."""

    def order(pair: tuple[ResidualTest | None, ResidualTest]) -> tuple[bool, bool, float]:
        after = pair[1]
        return not after.significant, after.about == "variance", -max(test.nats for test in pair if test)

    pairs = _test_pairs(diagnosis)
    return sorted(
        ((before, after) for before, after in pairs if after.significant or (before and before.significant)), key=order
    )


def _maps(diagnosis: Result) -> dict[str, Figure]:
    """Return a figure of every estimated fixed-pattern map by the effect's name."""
    drawn = {}
    for name in diagnosis.after.fit.maps:
        effect = diagnosis.model.effects[name]
        unit = effect.map_unit or next(iter(effect.about.values())).unit
        values = diagnosis.after.fit.hypothesis.maps[name]
        drawn[name] = pictures.map_figure(values, "relative" if unit == "1" else unit)
    return drawn


def _left_out(diagnosis: Result) -> dict[str, str]:
    """Return what was kept for verification, and how much of the field counts nowhere, as rows of the footer."""
    rows = {}
    if (verification := diagnosis.verification) is not None:
        captures = ", ".join(map(str, verification.captures))
        reached = f"χ² {chi2(verification.before.chi2)} → {chi2(verification.after.chi2)}"
        rows["verification"] = (
            f"captures {captures}, which no fit and no choice has seen: {reached}; the verdict rests on it"
        )
    split = diagnosis.split.describe()
    if any(split["border"].values()):
        sides = ", ".join(f"{width} {side}" for side, width in split["border"].items())
        rows["surround"] = (
            f"what lies beyond the patterns is unknown: pixels along the sides count nowhere ({sides}), "
            f"{100 * split['counted_fraction']:.0f} % are left"
        )
    return rows


def _footer(diagnosis: Result, provenance: Provenance) -> dict[str, str]:
    split = diagnosis.split.describe()
    captures = ", ".join(map(str, split["held_out_captures"])) or "none"
    held_out = (
        f"captures {captures} as numbered in the file, and {split['held_out_blocks']}: "
        f"{100 * split['held_out_fraction']:.0f} % of all pixels"
    )
    noise, datasheet = [], datasheet_noise(diagnosis.observation)[0].effects
    for name, values in diagnosis.after.fit.hypothesis.effects.items():
        if diagnosis.model.effects[name].noise:
            stated = name in diagnosis.stated_noise and values == datasheet[name]
            listed = ", ".join(f"{key} {value:.4g}" for key, value in values.items())
            noise.append(f"{name.replace('_', ' ')}: {listed} ({'stated by the file' if stated else 'estimated'})")
    rows = {"held out": held_out, **_left_out(diagnosis), "noise": "; ".join(noise)}
    rows |= {"effects": considered(diagnosis.considered), "command": provenance.command}
    rows["run time"] = "" if provenance.runtime_s is None else f"{provenance.runtime_s:.1f} s"
    rows["version"] = f"sci_lightning {installed_version()}, seed {diagnosis.seed}"
    return {title: content for title, content in rows.items() if content}
