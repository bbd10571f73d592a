"""A file with known and unknown scenes: the known ones are fitted, the unknown ones judge the result once more."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.files.formats import check

FEW = ("mask_shift", "gain", "shot_noise", "read_noise")


@pytest.fixture(scope="module")
def result() -> Diagnosis:
    session = Session(
        size=(32, 32), frames=4, mask="binary", unknown=4, aperture=0.28, dark=2, flat=4, static=4, dynamic=4
    )
    captures = VirtualCamera(session, {"mask_shift": {"dx": 0.7, "dy": -0.4}}).capture(seed=3)
    measurement, black = captures.measurement.copy(), int((~captures.known).nonzero()[0][0])
    measurement[black] = 0
    measurement[black, 5, 9] = captures.full_scale  # a hot pixel, in which there is nothing to be predicted
    captures = replace(captures, measurement=measurement)
    return diagnose(captures, {name: vocabulary()[name] for name in FEW})


def test_they_judge_the_corrected_camera(result: Diagnosis) -> None:
    judged = result.unknown_scenes
    assert result.names == ("mask_shift",) and judged is not None and len(judged.captures) == 3
    assert judged.gap.after < 0.7 * judged.gap.before and judged.gap.p_value < 0.01
    assert judged.gap.after < judged.without_mask.before
    assert not set(judged.captures) & set(result.observation.number.tolist())


def test_the_report_says_so(result: Diagnosis, tmp_path: Path) -> None:
    result.save(tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    check("report", report)
    assert report["mode"] == "calibrated" and report["unknown_scenes"]["agree"][1] == 3
    assert "3 snapshots of unknown scenes: " in (tmp_path / "report.html").read_text()
