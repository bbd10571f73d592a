"""``report.html``: a diagnosis on one page that needs nothing else, for a supervisor and for a talk."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from matplotlib.figure import Figure

from sci_lightning.diagnosis.diagnosis import Diagnosis
from sci_lightning.diagnosis.report import pictures
from sci_lightning.diagnosis.report.digits import chi2, uncertainty
from sci_lightning.diagnosis.report.sentences import headline, parameter, say
from sci_lightning.diagnosis.report.svg import svg
from sci_lightning.diagnosis.residual_tests import SIGNIFICANT, ResidualTest
from sci_lightning.diagnosis.verdict import NEGLIGIBLE
from sci_lightning.files.plain_text import printable

MOST = 8
"""Residual tests that are drawn."""
WIDE = 7.0
"""Inches from which a figure is scrolled on a narrow page rather than made illegibly small."""
TEMPLATE = Path(__file__).with_suffix(".html")
VERDICTS = {
    "consistent": "consistent: nothing is missing",
    "explained": "explained",
    "partly_explained": "partly explained",
    "unexplained": "unexplained",
}


def report_page(found: Diagnosis, report: Mapping[str, Any], drawn: Mapping[str, Figure], command: str) -> str:
    """The page as HTML with its pictures in it.

    Args:
        found: the diagnosis.
        report: ``report.json``; ``captures`` and ``date`` are shown if they are in it.
        drawn: :func:`~sci_lightning.diagnosis.report.pictures.figures`.
        command: that was run.
    """
    sections = (
        _disagreement(drawn),
        _effects(found, report),
        _gap(report, drawn),
        _evidence(found, drawn),
        _tests(found),
        _left(found, report, drawn),
        _maps(found),
    )
    sentence = headline(report, found.remaining)
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=_text(_title(found, report)),
        verdict=report["verdict"],
        verdict_words=VERDICTS[report["verdict"]],
        headline=_typeset(sentence),
        source=_source(report),
        captures=_captures(found),
        cards=_cards(found, report),
        sections="\n".join(sections),
        footer=_footer(found, report, command),
    )


def _title(found: Diagnosis, report: Mapping[str, Any]) -> str:
    file, date = report.get("captures", {}).get("file", ""), report.get("date", "")[:10]
    parts = (f"{VERDICTS[report['verdict']]}: {', '.join(found.names) or 'no effect'}", file, date)
    return " \u00b7 ".join(filter(None, parts))


def _source(report: Mapping[str, Any]) -> str:
    """Which file was diagnosed, what it calls itself, and when."""
    captures = report.get("captures", {})
    file, name = captures.get("file", ""), captures.get("name", "")
    date = report.get("date", "")[:16].replace("T", " ")
    parts = (file, name if name and name != Path(file).stem else "", date and f"{date} UTC")
    return " &middot; ".join(_text(part) for part in parts if part)


def _captures(found: Diagnosis) -> str:
    seen = found.observation
    height, width = seen.size
    kinds = ", ".join(f"{seen.kinds.count(kind)} {kind}" for kind in sorted(set(seen.kinds)))
    held = "judged on pixels that no fit has seen" if found.split.held_out.any() else "nothing could be held out"
    return (
        f"{len(seen)} captures with known scenes ({kinds}), {height} &times; {width} pixels, {seen.frames} slots, "
        f"{seen.bit_depth} bits; {held}."
    )


def _cards(found: Diagnosis, report: Mapping[str, Any]) -> str:
    before, after = report["gap"]["before"], report["gap"]["after"]
    hits = [sum(test.significant for test in found.before.tests), len(found.remaining)]
    limit = after["chi2_limit"]
    note = f"; chance reaches {chi2(limit)} with {after['pixels']:,} pixels" if limit > NEGLIGIBLE else ""
    cards = [
        (f"{before['rmse_dn']:.3g} &rarr; {after['rmse_dn']:.3g} DN", "held-out RMS error"),
        (f"{chi2(before['chi2'])} &rarr; {chi2(after['chi2'])}", f"held-out reduced &chi;&sup2; (1 = noise{note})"),
        (f"{hits[0]} &rarr; {hits[1]}", f"of {len(found.before.tests)} questions find more than noise"),
        (str(len(report["effects"])), "effects named"),
    ]
    return "".join(f'<div class="card"><b>{value}</b><span>{label}</span></div>' for value, label in cards)


def _disagreement(drawn: Mapping[str, Figure]) -> str:
    return _section(
        "Where model and captures disagree",
        "<p>A residual is what is left of a pixel when the model has had its say, in units of the noise σ that it "
        "predicts: standard normal when the model is right. Before and after are drawn to the same scale, and what is "
        "left once more on its own scale if it cannot be made out on that one.</p>"
        + _figure(drawn["residuals.png"], "Residuals of every pixel, taken over all captures.")
        + _figure(drawn["example.png"], "The held-out capture that the ideal camera misses most."),
    )


def _effects(found: Diagnosis, report: Mapping[str, Any]) -> str:
    if not report["effects"]:
        return _section("What was found", "<p>No effect is worth its parameters.</p>")
    rows = []
    for effect in report["effects"]:
        evidence = effect["evidence"].get("delta_nll")
        for number, (name, content) in enumerate(effect["parameters"].items()):
            named = (effect["name"], effect["stage"]) if number == 0 else ("", "")
            unit = "" if content["unit"] == "1" else content["unit"]
            value, error = parameter(content).split(" ")[0], uncertainty(content["std"])
            lost = "" if evidence is None or number else f"{evidence:,.0f}"
            rows.append((*named, name, value, error and f"\u00b1 {error}", unit, lost))
    head = ("effect", "stage", "parameter", "value", "statistical error (1 \u03c3)", "unit", "nats lost without it")
    sentences = "".join(f"<li>{_typeset(say(effect))}</li>" for effect in report["effects"])
    parts = [f"<ul>{sentences}</ul>" if len(report["effects"]) > 1 else "", _table(head, rows)]
    parts.append(f'<p class="quiet">{escape(report["uncertainty"])}</p>')
    names, correlation = list(found.correlation.names), found.correlation.matrix
    if len(names) == 2:
        pair = f"The errors of {names[0]} and {names[1]} are correlated by {float(correlation[0, 1]):.2f}."
        parts.append(f"<p>{_typeset(pair)}</p>")
    elif len(names) > 2:
        figure = pictures.correlation_figure(names, correlation)
        parts.append(
            _figure(figure, "How the parameters' errors go together: far from 0, the captures leave a trade-off.")
        )
    return _section("What was found", "".join(parts))


def _gap(report: Mapping[str, Any], drawn: Mapping[str, Figure]) -> str:
    gaps = [report["gap"][when] for when in ("before", "after")]
    head = ("kind", "RMS error (DN)", "chi2", "nats per pixel")
    rows = []
    for kind in (*gaps[0]["by_kind"], "all"):
        pair = [gap if kind == "all" else gap["by_kind"][kind] for gap in gaps]
        columns = ((key, chi2 if key == "chi2" else _three) for key in ("rmse_dn", "chi2", "nll"))
        rows.append((kind, *(" \u2192 ".join(write(gap[key]) for gap in pair) for key, write in columns)))
    drawings = (
        _figure(
            drawn["histogram.png"], "Residuals against the standard normal that they follow when the model is right."
        ),
        _figure(drawn["gap.png"], "Reduced chi2 of held-out pixels by kind of capture."),
    )
    numbers = '<p class="quiet">On held-out pixels, before \u2192 after.</p>' + _table(head, rows, "figures")
    return _section("How far apart they are", f'<div class="pair">{"".join(drawings)}</div>{numbers}')


def _three(value: float) -> str:
    """Three significant digits, without an exponent."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _evidence(found: Diagnosis, drawn: Mapping[str, Figure]) -> str:
    if not found.rounds:
        return ""
    text = (
        "<p>Every round looks at all candidates at a glance (mark), fits the promising ones jointly with all that is "
        "in the model already (bar), and adds the best (blue) if held-out pixels agree.</p>"
    )
    return _section(
        "Why these names", text + _figure(drawn["evidence.png"], "Gain of every candidate, round by round.")
    )


def _tests(found: Diagnosis) -> str:
    before = {test.name: test for test in found.before.tests}
    pairs = [(before.get(after.name), after) for after in found.after.tests]
    rows = []
    for first, after in pairs:
        cells = [_p_cell(label, test) for label, test in (("p before", first), ("p after", after))]
        name = f'<td data-label="name">{_text(after.name)}</td><td data-label="question">{_text(after.question)}</td>'
        rows.append(f'<tr>{name}<td data-label="about">{after.about}</td>{"".join(cells)}</tr>')
    head = "".join(f"<th>{title}</th>" for title in ("name", "question to the residuals", "about"))
    head += '<th class="n">p before</th><th class="n">p after</th>'
    table = f'<div class="scroll"><table class="stack tests-table"><tr>{head}</tr>{"".join(rows)}</table></div>'
    text = (
        f"<p>p-values are corrected (Holm) for how many questions are asked; below {SIGNIFICANT:g} counts as found. "
        "Noise can explain what is said about variance, nothing else.</p>"
    )
    if aside := sum(test.significant for test in found.after.tests) - len(found.remaining):
        text += (
            f"<p>Afterwards {aside} of them find something that does not count against the model: less than comes from "
            "the formulas of strong effects being a little inexact, or a p-value that is only just small enough.</p>"
        )
    hits = [(first, after) for first, after in pairs if after.significant or (first and first.significant)]
    hits.sort(key=lambda pair: (not pair[1].significant, pair[1].about == "variance", -_nats(pair)))
    shown = [
        f"<div><h3>{escape(after.question)}</h3>{_figure(pictures.test_figure(first, after), '')}</div>"
        for first, after in hits[:MOST]
    ]
    if len(hits) > MOST:
        text += f"<p>Of the {len(hits)} that found something, the {MOST} largest are drawn: what is left first.</p>"
    return _section("Questions to the residuals", f'{text}{table}<div class="tests">{"".join(shown)}</div>')


def _nats(pair: tuple[ResidualTest | None, ResidualTest]) -> float:
    return max(test.nats for test in pair if test)


def _p_cell(label: str, test: ResidualTest | None) -> str:
    if test is None:
        return "<td></td>"
    p_value = test.corrected
    kind = "hit" if p_value < SIGNIFICANT else "miss"
    text = "&lt; 1e-300" if p_value < 1e-300 else f"{p_value:.2g}"
    return f'<td class="n {kind}" data-label="{label}">{text}</td>'


def _left(found: Diagnosis, report: Mapping[str, Any], drawn: Mapping[str, Figure]) -> str:
    parts = []
    for number, each in enumerate(report["unnamed"], start=1):
        chance = "below 1e-300" if each["p_value"] < 1e-300 else f"{each['p_value']:.2g}"
        caption = f"{each['stage']}: {each['where']} (p {chance})"
        parts.append(_figure(drawn[f"unnamed_{number}.png"], caption))
    for effect in report["effects"]:
        if effect["alternatives"]:
            name, others = _text(effect["name"]), _text(" or ".join(effect["alternatives"]))
            parts.append(f"<p>The captures cannot tell <b>{name}</b> from {others}: either may be meant.</p>")
    if report["next_captures"]:
        items = "".join(f"<li>{_text(sentence)}</li>" for sentence in report["next_captures"])
        parts.append(f"<h3>What to record next</h3><ol>{items}</ol>")
    return _section("What is left", "".join(parts) or "<p>Nothing without a name, and no name in doubt.</p>")


def _maps(found: Diagnosis) -> str:
    parts = []
    for name in found.after.fit.maps:
        effect, values = found.model.effects[name], found.after.fit.hypothesis.maps[name]
        unit = next(iter(effect.about.values())).unit
        label = "relative" if unit == "1" else unit
        parts.append(_figure(pictures.chart_figure(values, label), f"Estimated map of {name}."))
    return _section("Estimated maps", f'<div class="pair">{"".join(parts)}</div>') if parts else ""


def _footer(found: Diagnosis, report: Mapping[str, Any], command: str) -> str:
    split, noise = report["split"], dict(report["noise"])
    stated = noise.pop("stated_by_the_file")
    told = [
        f"{name.replace('_', ' ')}: "
        + ", ".join(f"{key} {value:.4g}" for key, value in values.items())
        + (" (stated by the file)" if name in stated and name not in found.names else " (estimated)")
        for name, values in noise.items()
    ]
    rows = [
        (
            "held out",
            f"captures {', '.join(map(str, split['held_out_captures'])) or 'none'} as numbered in the file, and "
            f"{split['held_out_blocks']}: {100 * split['held_out_fraction']:.0f} % of all pixels",
        ),
        ("noise", "; ".join(told)),
        ("command", f"<code>{_text(command)}</code>"),
        ("run time", f"{report['runtime_s']:.1f} s"),
        ("version", f"sci_lightning {report['sci_lightning']}, seed {report['seed']}"),
    ]
    return "<table>" + "".join(f"<tr><th>{key}</th><td>{value}</td></tr>" for key, value in rows) + "</table>"


def _text(text: str) -> str:
    """Text for the page, whatever a path or a file contributes to it: no markup, and no control characters."""
    return escape(printable(text))


def _typeset(text: str) -> str:
    """Text for the page with chi squared and minus as they are printed."""
    return re.sub(r"(?<![\w.])-(?=\d)", "\u2212", _text(text).replace("chi2", "χ²"))


def _section(title: str, content: str) -> str:
    return f"<section><h2>{title}</h2>{content}</section>"


def _figure(figure: Figure, caption: str) -> str:
    note = f"<figcaption>{_text(caption)}</figcaption>" if caption else ""
    wide = ' class="wide"' if figure.get_size_inches()[0] > WIDE else ""
    return f'<figure{wide}><div class="scroll">{svg(figure, _text(caption))}</div>{note}</figure>'


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "stack") -> str:
    """A table; of kind ``stack``, every row becomes a list of labelled values where the page is narrow."""
    titles = [_typeset(cell) for cell in head]
    lines = ["".join(f"<th>{title}</th>" for title in titles)]
    for row in rows:
        cells = zip(titles, row, strict=True)
        lines.append("".join(f'<td data-label="{title}">{_typeset(cell)}</td>' for title, cell in cells))
    return (
        f'<div class="scroll"><table class="{kind}">' + "".join(f"<tr>{line}</tr>" for line in lines) + "</table></div>"
    )
