"""The table, from records made by hand."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from skimage.io import imread

from sci_lightning.studies.engine import FailedCase
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.studies.proving_ground.pictures import write_pictures
from sci_lightning.studies.proving_ground.reliability import Proportion
from sci_lightning.studies.proving_ground.report import write_report
from sci_lightning.studies.proving_ground.summary import SuiteScore, summarise
from tests.files.formats import check
from tests.studies.proving_ground.conftest import lost

GAIN = {"gain": {"factor": 1.1}}


def row(rows: list[SuiteScore], start: str) -> SuiteScore:
    (line,) = (row for row in rows if row.what.startswith(start))
    return line


def result(error: float) -> dict[str, dict[str, tuple[float, float]]]:
    return {"gain": {"factor": (1.1 + 0.01 * error, 0.01)}}


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),  # Newcombe, Statistics in Medicine 17 (1998), table I, method 3
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_interval(count: int, total: int, low: float, high: float) -> None:
    assert Proportion(count, total).interval == pytest.approx((low, high), abs=5e-5)
    assert Proportion(total - count, total).interval == pytest.approx((1 - high, 1 - low), abs=5e-5)


def test_wilson_interval_of_nothing() -> None:
    assert Proportion(0, 0).interval == (0, 1)


GHOST = {"ghost": {"fraction": 0.1, "dx": 5.0, "dy": 5.0}}


@pytest.fixture
def records(record: Callable[..., Any]) -> list[Outcome | FailedCase]:
    contents = [
        *(record("single", GAIN, result(error)) for error in (-2.5, -1, 0, 0.5, 1)),
        record("single", GAIN, result(1.5), verification={"captures": [3], "chi2": 1.2, "chi2_limit": 1.1}),
        record("single", GAIN, {}, nats=10),  # nobody could have seen it
        record("weak", GAIN, result(0), before=1.01, nats=50),
        record("weak", GAIN, result(0), before=1.2, nats=300),  # not weak
        record("pair", GAIN | {"black_level": {"offset": 0.1}}, result(0), after=2.0, verdict="partly_explained"),
        record("nothing", {}, {}),
        record("nothing", {}, result(0)),
        record("nothing", {}, {}, mask="binary"),
        record("outside", GHOST, {}, unnamed=("optics",), verdict="unexplained"),
        record("outside", GHOST, result(0), memory_mib=5000.0, size=[128, 128], frames=8, seconds=61.0),
    ]
    outcomes = [Outcome.model_validate(content) for content in contents]
    return [*outcomes[:7], lost(), *outcomes[7:]]


def test_rows(records: list[Outcome | FailedCase]) -> None:
    rows = summarise(records)
    shares = {
        "single effect, clear": (6, 7, False),
        "single effect, weak": (1, 1, True),
        "pairs": (0, 1, False),
        "triples": (0, 0, None),
        "nothing hidden, structural": (1, 2, False),
        "nothing hidden, binary": (0, 1, True),
        "right names, yet": (0, 8, True),
        "any wrong name": (0, 10, True),
        "outside the vocabulary: any wrong name": (1, 2, False),
        "outside the vocabulary: strongest unnamed": (1, 2, False),
        "fewer captures": (0, 0, None),
        "95 % intervals": (8, 9, False),
        "right names: chi2 on verification": (7, 8, False),
        "95% of chi2's excess": (7, 8, False),
    }
    for start, (count, total, met) in shares.items():
        line = row(rows, start)
        assert line.proportion == Proportion(count, total), start
        assert line.met is met, start
    assert row(rows, "single effect, clear").missed == ("single-bad failed",)
    assert row(rows, "95 % intervals").missed[0].startswith("gain.factor -2.5 std: gain (")
    assert row(rows, "single effect, clear").figure.endswith("; 1 not asked: too faint or too strong")
    assert "errors of 1.09 stated standard deviations" in row(rows, "95 % intervals").figure
    assert row(rows, "time, 64 x 64").met is None and "4.0 s of a processor" in row(rows, "time, 64 x 64").figure
    assert row(rows, "time, 128 x 128").met is False and row(rows, "memory").met is False
    assert row(rows, "cases that failed").missed == ("single-bad: ValueError: no",)


def test_names_that_are_stated_with_certainty(record: Callable[..., Any]) -> None:
    contents = [record("single", GAIN, result(0)), record("outside", GHOST, result(0), verdict="unexplained")]
    assert not [one for one in summarise(map(Outcome.model_validate, contents)) if one.what.startswith("names with")]
    for content, probability in zip(contents, (0.99, 0.96), strict=True):
        content["found"][0]["probability"] = probability
    line = row(summarise(map(Outcome.model_validate, contents)), "names with")
    assert line.proportion == Proportion(1, 2) and line.missed[0].startswith("gain: ghost -> gain")


def test_failed_cases_count_where_they_belong() -> None:
    rows = summarise(
        [
            lost(case="rays-bad", suite="single", formulation="rays", mask="binary"),
            lost(case="nothing-bad", suite="nothing", mask="binary"),
        ]
    )
    assert row(rows, "single effect, clear").proportion == Proportion(0, 0)
    assert row(rows, "nothing hidden, structural").proportion == Proportion(0, 0)
    assert row(rows, "nothing hidden, binary").missed == ("nothing-bad failed",)
    assert row(rows, "rays: the hidden effects").missed == ("rays-bad failed",)


def test_rows_of_other_settings(record: Callable[..., Any]) -> None:
    rays = {"formulation": "rays", "also_true": ["prnu"]}
    pixels = {"prnu": {"std": (0.005, 0.0001)}}
    contents = [
        record("single", GAIN, result(0), case="a"),
        record("single", GAIN, {}, case="b", frames=4, bit_depth=12, datasheet="silent"),
        record("nothing", {}, pixels, case="c", unnamed=("exposure",), verdict="partly_explained", **rays),
        record("nothing", {}, result(0), case="d", **rays),
        record("single", GAIN, {**result(0), **pixels}, case="e", total_cpu_seconds=3592.0, **rays),
    ]
    rows = summarise([Outcome.model_validate(content) for content in contents])
    shares = {
        "4 slots: right": (0, 1),
        "8 slots: right": (1, 1),
        "12 bits: right": (0, 1),
        "datasheet silent: right": (0, 1),
        "single effect, clear": (1, 2),  # without those of rays
        "rays, nothing hidden: any name but": (1, 2),
        "rays, nothing hidden: any name": (2, 2),
        "rays: the hidden effects": (1, 1),
        "rays: any wrong": (0, 1),
        "rays: the verdict": (1, 3),
    }
    for start, (count, total) in shares.items():
        exact = [line for line in rows if line.what == start]
        (line,) = exact or [line for line in rows if line.what.startswith(start)]
        assert line.proportion == Proportion(count, total), start
    assert row(rows, "processor time of all cases").figure == "1.00 hours of one core for 5 cases"


def test_files(records: list[Outcome | FailedCase], tmp_path: Path) -> None:
    rows = summarise(records)
    write_report(tmp_path, rows)
    text = (tmp_path / "summary.md").read_text()
    assert "| pairs: exact set of names, explained | 0.0% (0 of 1; 0% to 79%) | at least 95% | **no** |" in text
    assert "- pairs: exact set of names, explained: 0.0% (0 of 1; 0% to 79%); the target is at least 95%." in text
    assert "- gain + black_level -> gain (structural, 8 bits; chi2 10 to 2, 5 s)" in text
    assert re.search("Not tried: triples: .*; fewer captures: ", text)
    content = json.loads((tmp_path / "summary.json").read_text())
    check("proving_ground_summary", content)
    single = content["rows"][0]
    assert (single["count"], single["total"], single["met"]) == (6, 7, False)
    assert "met" not in next(row for row in content["rows"] if row["what"].startswith("triples"))


def test_pictures(records: list[Outcome | FailedCase], tmp_path: Path) -> None:
    paths = write_pictures(tmp_path, records)
    assert [path.name for path in paths] == ["confusion.png", "coverage.png", "gap.png", "time.png"]
    for path in paths:
        picture = imread(path)
        assert picture.shape[0] > 300 and picture.std() > 5, path
    assert write_pictures(tmp_path, records[7:8]) == []
