"""Captures that are kept for verification are seen by no fit and no choice, and the verdict rests on them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sci_lightning.captures import Captures, read_captures, write_captures
from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.fit.split import set_aside
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.report.sentences import headline
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, VirtualCamera

FEW = {name: vocabulary()[name] for name in ("gain", "black_level", "shot_noise", "read_noise")}


@pytest.fixture(scope="module")
def captures() -> Captures:
    return VirtualCamera(Session(size=(32, 32)), {"gain": {"factor": 0.9}}).capture(3)


@pytest.fixture(scope="module")
def result(captures: Captures) -> Diagnosis:
    return diagnose(captures, FEW)


def test_one_in_five_of_each_kind(captures: Captures) -> None:
    seen, unseen = set_aside(observe(captures), 5)
    assert unseen is not None and len(seen) + len(unseen) == len(captures)
    assert sorted(unseen.kinds) == ["dynamic", "flat", "pattern", "pattern", "static"]
    assert not set(seen.number.tolist()) & set(unseen.number.tolist())
    assert (unseen.dn == observe(captures).dn[[n in unseen.number for n in observe(captures).number]]).all()
    assert set_aside(observe(captures), 0)[1] is None
    backwards = captures.take(list(range(len(captures)))[::-1])
    other = set_aside(observe(backwards), 5)[1]
    assert other is not None
    assert {len(captures) - 1 - number for number in other.number.tolist()} == set(unseen.number.tolist())


def test_the_file_may_choose(captures: Captures, tmp_path: Path) -> None:
    chosen = write_captures(tmp_path / "a.h5", replace(captures, verification=(3, 20)))
    assert chosen.verification == read_captures(tmp_path / "a.h5").verification == (3, 20)
    unseen = set_aside(observe(chosen), 5)[1]
    assert unseen is not None and set(unseen.number.tolist()) == {3, 20}
    assert chosen.take([20, 0, 3]).verification == (0, 2)
    assert set_aside(observe(replace(captures, verification=())), 5)[1] is None
    with pytest.raises(BadInput, match=r"every capture .*set aside"):
        set_aside(observe(replace(captures, verification=tuple(range(len(captures))))), 5)


def test_what_is_kept_changes_nothing_but_the_verdict(captures: Captures, result: Diagnosis) -> None:
    """Ruin the captures that are kept: the fit stays the same to the last bit, and the verdict does not."""
    assert result.verification is not None and result.verdict == "explained"
    assert 0.9 < result.verification.after.chi2 < result.verification.after.chi2_limit < result.verification.before.chi2
    ruined = captures.measurement.copy()
    ruined[list(result.verification.captures)] = np.minimum(
        captures.measurement[list(result.verification.captures)], 60
    )
    other = diagnose(replace(captures, measurement=ruined, verification=tuple(result.verification.captures)), FEW)
    told = [one.after.fit.hypothesis.effects["gain"]["factor"] for one in (result, other)]
    assert told[0] == told[1] and result.after.gap == other.after.gap
    assert other.verdict != "explained" and "on captures that nothing has seen" in headline(other)


def test_the_report_says_which_is_which(result: Diagnosis) -> None:
    content = describe(result)
    assert content["format_version"] == 3 and content["mode"] == "calibrated" and content["laboratory"] == []
    assert result.verification is not None
    assert content["verification"]["captures"] == sorted(result.verification.captures)
    assert content["verification"]["chi2"] == result.verification.after.chi2
    kept, held_out = set(content["verification"]["captures"]), set(content["split"]["held_out_captures"])
    assert not kept & held_out and content["split"]["fitted_captures"] + len(kept | held_out) == 34


def test_without_any_the_report_says_so(captures: Captures) -> None:
    result = diagnose(captures.take([0, 5, 12, 25]), FEW)
    assert result.verification is None and describe(result)["verification"]["captures"] == []
