"""A capture that contradicts all others is named and left out, and the diagnosis goes on."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from sci_lightning.captures import Captures
from sci_lightning.console import PlainConsole
from sci_lightning.diagnosis.bad_captures.suspects import most_bad, outlying, suspicious
from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.report.report_page import ReportProvenance, report_page
from sci_lightning.diagnosis.report.terminal import print_report
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.diagnosis import another_camera
from tests.files.formats import check

NAMES = ("gain", "black_level", "mask_shift", "mask_contrast", "scene_shift", "shot_noise", "read_noise")
FEW = {name: vocabulary()[name] for name in NAMES}
VERIFICATION = (9, 13, 21, 31)
"""Captures that the files below keep for verification."""


@pytest.fixture(scope="module")
def captures() -> Captures:
    """34 captures of a camera whose gain is 0.9, no capture is bad."""
    camera = VirtualCamera(Session(size=(32, 32), surround="dark"), {"gain": {"factor": 0.9}})
    return replace(camera.capture(3), verification=VERIFICATION)


def mislabelled(captures: Captures, number: int) -> Captures:
    """The same captures, one of them with its sequence in reverse order."""
    sequence = captures.sequence.copy()
    sequence[number] = sequence[number, ::-1]
    return replace(captures, sequence=sequence)


@pytest.fixture(scope="module")
def result(captures: Captures) -> Diagnosis:
    """Capture 29 is mislabelled among those for fits, and 31 among those for verification."""
    return diagnose(mislabelled(mislabelled(captures, 29), 31), FEW)


def test_both_are_named_and_the_diagnosis_goes_on(result: Diagnosis) -> None:
    fitted, unseen = result.bad_captures
    assert (fitted.number, fitted.role, fitted.kind) == (29, "fits and choices", "dynamic")
    assert (unseen.number, unseen.role) == (31, "verification")
    assert fitted.chi2 > 10 > 1.5 > fitted.others_chi2
    assert "its sequence looks like its own in reverse order" in fitted.sentence or "capture" in fitted.appearance
    assert result.names == ("gain",) and result.verdict == "explained"
    gain = result.effects[0].parameters["factor"]
    assert abs(float(gain.value) - 0.9) < 4 * gain.std
    assert 29 not in result.observation.number.tolist()
    assert result.verification is not None and set(result.verification.captures) == set(VERIFICATION) - {31}


def test_every_report_says_so(result: Diagnosis) -> None:
    content = describe(result)
    check("report", content)
    assert [capture["capture"] for capture in content["bad_captures"]] == [29, 31]
    assert "capture 29 (dynamic) " in content["bad_captures"][0]["sentence"]
    earlier = {name: value for name, value in content.items() if name != "bad_captures"}
    check("report", earlier)  # written before such captures were looked for
    with pytest.raises(ValidationError):
        check("report", content | {"bad_captures": [{"capture": 1}]})
    page = report_page(result, ReportProvenance(), result.plot())
    assert "Left out:" in page and "capture 31 (dynamic, kept for verification)" in page
    console = PlainConsole(file=io.StringIO(), width=200)
    print_report(result, console)
    assert "left out: capture 29 (dynamic)" in console.file.getvalue()  # type: ignore[attr-defined]


def test_nobody_is_accused_among_good_captures(captures: Captures) -> None:
    messages: list[str] = []
    result = diagnose(captures, FEW, on_progress=messages.append)
    assert result.bad_captures == () and result.verdict == "explained"
    assert not [message for message in messages if "without" in message]


@pytest.mark.slow
def test_it_can_be_switched_off(captures: Captures) -> None:
    result = diagnose(mislabelled(captures, 29), FEW, settings=SearchSettings(find_bad_captures=False))
    assert result.bad_captures == () and result.verdict != "explained"


@pytest.mark.parametrize(
    ("what", "looks"),
    [
        ("saturated", "its light looks 3"),
        pytest.param("no light", "as if no light had come in", marks=pytest.mark.slow),
        pytest.param("other", "capture 24", marks=pytest.mark.slow),
        pytest.param("moved", "looks displaced by", marks=pytest.mark.slow),
    ],
)
def test_what_it_looks_like(what: str, looks: str) -> None:
    hidden = another_camera.Hidden(black=0.03)
    captures = another_camera.captures(hidden, size=32, seed=5, frames=4)
    number, dn = 26, captures.measurement.copy()
    changed = {
        "saturated": replace(hidden, gain=3.2),
        "no light": replace(hidden, gain=1e-9),
        "moved": replace(hidden, scene_shift=(1.7, -1.2)),
    }
    if what == "other":
        dn[number] = dn[24]
    else:
        dn[number] = another_camera.captures(changed[what], size=32, seed=5, frames=4).measurement[number]
    result = diagnose(replace(captures, measurement=dn), FEW)
    assert [capture.number for capture in result.bad_captures] == [number]
    assert looks in result.bad_captures[0].sentence, result.bad_captures[0].sentence
    assert result.names == ("black_level",) and result.verdict == "explained"


def test_who_is_accused() -> None:
    kinds = ["static"] * 10 + ["flat"] * 10
    misfit = torch.ones(20, dtype=torch.float64)
    assert not outlying(misfit, kinds, most_bad(20)).any()
    misfit[[3, 15]] = torch.tensor([30.0, 4.0], dtype=torch.float64)
    assert outlying(misfit, kinds, most_bad(20)).nonzero()[:, 0].tolist() == [3, 15]
    misfit[5:9] = 3.5  # others do not fit either: an effect is missing
    assert not outlying(misfit, kinds, most_bad(20)).any()
    alone = torch.tensor([20.0, *[1.0] * 19], dtype=torch.float64)
    assert not outlying(alone, ["dark", *kinds[1:]], most_bad(20)).any()  # nothing else shows what it shows
    assert outlying(alone, kinds, most_bad(20))[0]


def test_who_is_suspected() -> None:
    misfit = torch.full((20,), 0.1, dtype=torch.float64)  # noise that a bad capture made too large
    assert not suspicious(misfit, 2).any()
    misfit[4] = 20.0
    assert suspicious(misfit, 2).nonzero()[:, 0].tolist() == [4]
    assert not suspicious(torch.tensor(np.geomspace(1, 30, 20)), 2).any()
