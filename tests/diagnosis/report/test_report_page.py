"""The page needs nothing but itself, and says what was found."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from omegaconf import OmegaConf

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose, remaining_tests
from sci_lightning.diagnosis.fit.gap import Gap, Misfit
from sci_lightning.diagnosis.report.pictures import (
    evidence_figure,
    example_figure,
    figures,
    gap_figure,
    residuals_figure,
    unnamed_figure,
)
from sci_lightning.diagnosis.report.pictures import test_figure as draw_test_figure
from sci_lightning.diagnosis.report.report import describe, write_report
from sci_lightning.diagnosis.report.report_page import WIDE_INCHES, ReportProvenance, report_page
from sci_lightning.diagnosis.report.svg import svg
from sci_lightning.diagnosis.residual_tests.drawing import OWN, nearly_largest
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed
from sci_lightning.diagnosis.search.selection import Round
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.files.formats import check

VOID = {"meta", "link", "br", "img", "input"}


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """A shift and a map: a page with every section."""
    path = tmp_path_factory.mktemp("page") / "a.h5"
    hidden = {"mask_shift": {"dx": 0.61, "dy": -0.35}, "column_noise": {"std": 0.02}}
    VirtualCamera(Session(size=(32, 40)), hidden).write(path, seed=3)
    few = {name: vocabulary()[name] for name in ("mask_shift", "column_noise", "gain", "shot_noise", "read_noise")}
    return diagnose(read_captures(path), few)


SOURCE = ReportProvenance(
    file="a<b>.h5",
    name="Lab 1",
    date="2026-11-21T23:05:06+00:00",
    runtime_s=1.5,
    command="python -m sci_lightning.diagnose captures='<a>.h5'",
)


def test_the_scale_of_a_large_sensors_residuals() -> None:
    """More values than torch takes a quantile of."""
    many = torch.zeros(2, 3000, 3000)
    many[:, ::100] = 5.0  # one row in a hundred
    assert nearly_largest(many) == 5.0


def blank_figures(result: Diagnosis) -> dict[str, Figure]:
    """Empty figures in the place of those of the diagnosis, where the test is about texts; they are drawn at once."""
    names = ("residuals", "example", "histogram", "gap", "evidence")
    unnamed = (f"unnamed_{number}" for number, _ in enumerate(result.unnamed, start=1))
    return {f"{name}.png": Figure(figsize=(1, 1)) for name in (*names, *unnamed)}


def page(result: Diagnosis, source: ReportProvenance = SOURCE) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sci_lightning.diagnosis.report.sections.MAX_TEST_FIGURES", 1)
        return report_page(result, source, blank_figures(result))


@pytest.fixture(scope="module")
def text(result: Diagnosis) -> str:
    """The page of ``found`` with all figures."""
    return report_page(result, SOURCE, figures(result))


class Tags(HTMLParser):
    """Complains of elements that are not closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_it_is_well_formed_and_needs_nothing_else(text: str) -> None:
    tags = Tags()
    tags.feed(text)
    assert not tags.open
    assert not re.search(r"<script|<link|@import|src=", text)
    assert not re.search(r'href="(?!#|data:)', text)
    assert "$" not in re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL)


def test_it_says_what_was_found(result: Diagnosis, text: str) -> None:
    assert re.search(
        r"<h1>The mask&#39;s image .* \(0\.6[01]\d*( ± 0\.\d+)?, \u22120\.3[45].* pixel and columns differ", text
    )
    command = "captures=&#39;&lt;a&gt;.h5"
    for words in (
        "column_noise",
        "error (1 σ)",
        "Uncertainties are one standard deviation",
        "Estimated map of column_noise",
        "The errors of mask_shift dx and mask_shift dy are correlated by",
        "chance reaches" if result.after.gap.chi2_limit > 1.05 else "(1 = noise)",
        command,
        "1.5 s",
    ):
        assert words in text, words
    for test in result.after.tests:
        assert f'<td data-label="name">{test.name}</td>' in text


def test_what_is_left_and_what_to_do(result: Diagnosis) -> None:
    ambiguous = replace(result.effects[0], alternatives=("mask_scale",), tell_apart="Record 3.")
    ghost = Unnamed("ghost", "optics", "a second image", 1e-20, 99.0, torch.rand(32, 40))
    other = replace(result, effects=(ambiguous, *result.effects[1:]), unnamed=(ghost,))
    text = page(other)
    assert "optics: a second image (p 1e-20)" in text
    assert "cannot tell <b>mask_shift</b> from mask_scale" in text
    assert "(or it is mask_scale, " in text
    assert "<li>Record 3.</li>" in text
    report = describe(other)
    assert report["unnamed"][0]["picture"] == "unnamed_1.png" and report["next_captures"] == ["Record 3."]
    check("report", json.loads(json.dumps(report)))


def test_files(result: Diagnosis, tmp_path: Path) -> None:
    write_report(result, tmp_path, SOURCE, blank_figures(result))
    report = json.loads((tmp_path / "report.json").read_text())
    check("report", report)
    assert report["captures"] == {"file": "a<b>.h5", "name": "Lab 1"} and report["runtime_s"] == 1.5
    assert report["date"] == SOURCE.date and list(report)[-3:] == ["captures", "date", "runtime_s"]
    written = {path.name for path in tmp_path.iterdir()} - set(blank_figures(result))
    assert written == {"report.json", "report.html", "encoder.yaml", "patterns.npy", "column_noise.npy"}
    assert set(blank_figures(result)) == set(figures(result))
    encoder = OmegaConf.load(tmp_path / "encoder.yaml")
    camera = [name for name in result.after.fit.hypothesis.effects if name not in result.model.imperfections]
    assert list(encoder.effects) == camera
    assert encoder.effects.mask_shift.dx == result.effects[0].parameters["dx"].value  # to the last digit


def test_a_report_without_provenance(result: Diagnosis) -> None:
    text = page(result, ReportProvenance())
    assert "<title>explained: mask_shift, column_noise</title>" in text
    assert not re.search(r"<th>(run time|command)</th>", text) and ReportProvenance().describe() == {}


def test_a_page_of_a_camera_in_which_nothing_is_hidden(tmp_path: Path) -> None:
    VirtualCamera(Session(size=(32, 32))).write(tmp_path / "a.h5", seed=3)
    few = {name: vocabulary()[name] for name in ("gain", "shot_noise", "read_noise")}
    text = page(diagnose(read_captures(tmp_path / "a.h5"), few))
    assert "<h1>The captures agree with the ideal camera" in text
    assert "No effect is worth its parameters" in text


@pytest.fixture(scope="module")
def noisy() -> Diagnosis:
    """A camera that reads out more noise than its datasheet says, which leaves the RMS error as it is."""
    few = {name: vocabulary()[name] for name in ("gain", "shot_noise", "read_noise")}
    return diagnose(VirtualCamera(Session(size=(32, 32)), {"read_noise": {"std": 4.0}}).capture(seed=3), few)


def test_the_first_tile_is_what_fell(result: Diagnosis, noisy: Diagnosis) -> None:
    shift, noise = (
        re.findall(r'<div class="card"><b>(.*?)</b><span>(.*?)</span>', page(one)) for one in (result, noisy)
    )
    assert "→" in shift[0][0] and shift[0][0].endswith("DN")
    assert noisy.names == ("read_noise",)
    assert "→" in noise[0][0] and "χ²" in noise[0][1]
    for value, _ in (*shift, *noise):
        before, arrow, after = value.removesuffix(" DN").partition(" → ")
        assert not arrow or before != after, value
    likelier = replace(noisy.before, gap=replace(noisy.after.gap, nll=noisy.after.gap.nll + 0.01))
    (first, label), *_ = re.findall(
        r'<div class="card"><b>(.*?)</b><span>(.*?)<', page(replace(noisy, before=likelier))
    )
    assert first.endswith("nats") and "likelier" in label


def test_no_column_is_empty(result: Diagnosis, noisy: Diagnosis) -> None:
    """Noise, without which there is no model, has no nats that were lost without it; a gain has no unit."""
    for one in (result, noisy):
        for table in re.findall(r'<table class="stack">.*?</table>', page(one), flags=re.DOTALL):
            titles, *rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in table.split("<tr>")[1:]]
            assert rows and all(len(row) == len(titles) for row in rows)
            assert all(any(row[place] for row in rows) for place, _ in enumerate(titles)), titles
    assert "nats lost without it" in page(result) and "nats lost without it" not in page(noisy)


def test_what_is_named_is_nowhere_rejected(noisy: Diagnosis) -> None:
    """Noise is judged after the rounds of the search, in none of which it is added."""
    assert re.search("<b>read_noise</b> was named afterwards", page(noisy))
    titles = [axes.get_title(loc="left") for axes in evidence_figure(noisy.rounds, noisy.names).axes]
    assert titles and not any("worth" in title for title in titles)


def test_residuals_are_whole_where_the_page_is_narrow(result: Diagnosis) -> None:
    """No wider than what a telephone shows without scrolling, with panels on their own scale and without."""
    before, after = result.before.residuals, result.after.residuals
    loud = replace(before, raw=300 * after.raw)
    drawn = [draw(one, after) for draw in (residuals_figure, example_figure) for one in (loud, after)]
    tests = {test.name: test for test in result.before.tests}
    drawn += [draw_test_figure(tests.get(test.name), test) for test in result.after.tests]
    assert max(figure.get_size_inches()[0] for figure in drawn) <= WIDE_INCHES


def test_it_names_the_file_and_the_day(text: str) -> None:
    assert "a&lt;b&gt;.h5 · Lab 1 · 2026-11-21 23:05 UTC</p>" in text
    assert "<title>explained: mask_shift, column_noise · a&lt;b&gt;.h5 · 2026-11-21</title>" in text


def test_what_files_contribute_is_shown_and_never_obeyed(result: Diagnosis) -> None:
    evil = "<img src=x onerror=alert(1)>\x1b[31m\u202e&"
    own = type("Evil", (result.effects[0].effect,), {"name": evil, "stage": evil, "sentence": ""})
    effect = replace(result.effects[0], effect=own, alternatives=(evil,), tell_apart=evil)
    ghost = Unnamed(evil, evil, evil, 1e-20, 99.0, torch.rand(32, 40))
    rounds = (Round({evil: 9.0}, {}, None),)
    other = replace(result, effects=(effect, *result.effects[1:]), unnamed=(ghost,), rounds=rounds)
    text = page(other, ReportProvenance(evil, evil, evil, 1.0, evil))
    text += svg(evidence_figure(rounds, ()), evil) + svg(unnamed_figure(ghost), evil)
    assert "<img" not in text and "\x1b" not in text and "\u202e" not in text
    assert text.count("&lt;img src=x onerror=alert(1)&gt;\\x1b[31m\\u202e&amp;") > 10


def test_tables_are_stacked_where_the_page_is_narrow(text: str) -> None:
    """A table of many columns does not fit a telephone: its cells then carry their column's title."""
    for table in re.findall(r'<table class="stack.*?</table>', text, flags=re.DOTALL):
        assert not re.search(r"<td(?! data-label| class=\"n \w+\" data-label)[^>]*>[^<]", table)
    assert text.count('<table class="stack') == 2


def test_a_wide_figure_scrolls_by_itself_where_the_page_is_narrow(text: str) -> None:
    """A column of a grid is as wide as its content, unless it is told that it may be narrower."""
    narrow = text[text.index("@media (max-width: 34rem)") :]
    assert ".tests { grid-template-columns: minmax(0, 1fr); }" in narrow and ".wide svg { min-width" in narrow


def test_what_is_left_is_drawn_on_its_own_scale(result: Diagnosis) -> None:
    """Residuals of 300 sigma before leave those of 1 sigma after white, or all of one purple."""
    before, after = result.before.residuals, result.after.residuals
    loud = replace(before, raw=300 * after.raw)
    for figure, alone in ((residuals_figure(loud, after), 2), (example_figure(loud, after), 1)):
        panels = [axes for axes in figure.axes if axes.get_title(loc="left") == OWN]
        assert len(panels) == alone
        for axes in panels:
            low, high = axes.images[0].get_clim()
            assert high - low < 12
    for figure in (residuals_figure(after, after), example_figure(after, after)):
        assert OWN not in [axes.get_title(loc="left") for axes in figure.axes]


@pytest.mark.parametrize("shape", [(32, 32), (32, 40), (64, 32)])
def test_no_label_of_the_residuals_is_cut_off(result: Diagnosis, shape: tuple[int, int]) -> None:
    after = replace(result.after.residuals, raw=torch.randn(8, *shape))
    for before in (after, replace(after, raw=300 * after.raw)):
        figure = residuals_figure(before, after)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        width, height = canvas.get_width_height()
        for axes in figure.axes:
            for label in (axes.xaxis.label, axes.yaxis.label):
                box = label.get_window_extent()
                assert not label.get_text() or (box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height)


@pytest.mark.parametrize("nats", [30.0, 3e3, 2e5, 3e7, 1e12])
def test_labels_of_large_evidence_do_not_overlap(nats: float) -> None:
    rounds = tuple(Round({"gain": nats, "prnu": 2.0}, {"gain": (nats, nats)}, "gain") for _ in range(2))
    for figure in (evidence_figure(rounds, ("gain",)), gap_figure(gap_of(nats), gap_of(1.0))):
        FigureCanvasAgg(figure).draw()
        for axes in figure.axes:
            low, high = axes.get_xlim()
            labels = [tick.label1 for tick in axes.xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
            boxes = sorted((label.get_window_extent() for label in labels), key=lambda box: box.x0)
            assert len(boxes) >= 2
            assert all(left.x1 + 2 < right.x0 for left, right in pairwise(boxes))


def gap_of(chi2: float) -> Gap:
    return Gap(chi2, 1.0, 1.0, pixels=100, chi2_limit=1.05, by_kind={"flat": Misfit(chi2, 1.0, 1.0)})


def test_a_verdict_waits_for_the_residuals_to_be_noise(result: Diagnosis) -> None:
    assert result.verdict == "explained"
    assert not result.remaining
    unlike = replace(result.after, fit=result.before.fit, residuals=result.before.residuals, tests=result.before.tests)
    left = remaining_tests(result.before, unlike)  # the gap is that of a good model, the residuals are not
    assert left
    less = replace(result, remaining=left)
    assert less.verdict != "explained"
