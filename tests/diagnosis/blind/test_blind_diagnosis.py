"""Snapshots of unknown scenes, taken by a camera that shares no code with the encoder, are diagnosed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sci_lightning.captures import Captures, write_captures
from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis, diagnose_blind
from sci_lightning.diagnosis.blind.block_prediction import PredictionVerdict
from sci_lightning.diagnosis.blind.candidate_comparison import MaskEvidence
from sci_lightning.diagnosis.blind.held_out_pixels import PairedComparison
from sci_lightning.diagnosis.report.report import describe, write_report
from sci_lightning.diagnosis.report.report_folder import report_folder
from sci_lightning.diagnosis.report.sentences import further_notes, headline
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.files.formats import check

NO_CALIBRATION = {"dark": 0, "flat": 0, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 0}
FEW = ("mask_shift", "mask_contrast", "pattern_order")


def snapshots(hidden: dict[str, Any] | None = None, count: int = 6, **session: Any) -> Captures:
    """Return snapshots of moving scenes that the captures do not state."""
    settings: dict[str, Any] = {"size": (32, 32), "frames": 4, "mask": "binary", "unknown": count, "aperture": 0.28}
    camera = VirtualCamera(Session(**NO_CALIBRATION, **(settings | session)), hidden)
    return camera.capture(seed=5)


def diagnosed(captures: Captures, names: tuple[str, ...] = FEW) -> BlindDiagnosis:
    whole = vocabulary()
    return diagnose_blind(captures, {name: whole[name] for name in (*names, "shot_noise", "read_noise", "gain")})


def test_snapshots_that_cannot_judge_do_not() -> None:
    """One is black and was to judge, another has a saturated pixel in every block: the others decide."""
    captures = replace(snapshots({"mask_shift": {"dx": 0.7, "dy": -0.4}}, count=8, size=(40, 40)), verification=(1, 6))
    dn = captures.measurement.copy()
    dn[1] = 0
    dn[4, ::4, ::4] = captures.full_scale
    result = diagnosed(replace(captures, measurement=dn))
    assert result.names == ("mask_shift",) and result.verdict == "explained"
    assert result.prediction is not None and np.isfinite(result.prediction.gap.after)
    assert result.predicted is not None and result.predicted.number.tolist() == [0, 2, 3, 5, 6, 7]
    assert result.prediction.verification is not None and result.prediction.verification.snapshots == 1
    assert any(note.startswith("Snapshot 1 is left out: black.") for note in result.notes)


def test_all_snapshots_are_set_aside() -> None:
    with pytest.raises(BadInput, match="sets all 6 captures of unknown scenes aside"):
        diagnosed(replace(snapshots(), verification=tuple(range(6))))


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        ({}, {}),
        ({"mask_shift": {"dx": 0.7, "dy": -0.4}}, {"mask_shift": {"dx": 0.7, "dy": -0.4}}),
        pytest.param({"mask_contrast": {"leak": 0.15}}, {"mask_contrast": {"leak": 0.15}}, marks=pytest.mark.slow),
        pytest.param({"mask_blur": {"sigma": 0.7}}, {"mask_blur": {"sigma": 0.7}}, marks=pytest.mark.slow),
        pytest.param({"pattern_order": {"offset": 1}}, {"pattern_order": {"offset": 1}}, marks=pytest.mark.slow),
        pytest.param(
            {"mask_orientation": {"operation": "flip_lr"}},
            {"mask_orientation": {"operation": "flip_lr"}},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_is_hidden_is_named(hidden: dict[str, Any], expected: dict[str, Any]) -> None:
    result = diagnosed(snapshots(hidden, size=(48, 48)), (*FEW, "mask_blur", "mask_orientation") if expected else FEW)
    assert result.names == tuple(expected)
    assert result.verdict == ("explained" if expected else "consistent")
    for effect in result.effects:
        least = 5 if effect.name == "pattern_order" else 6  # a scene that hardly moves does not show the order
        assert effect.snapshots == 6 and effect.agree >= least and effect.p_value < 0.01
        for name, value in expected[effect.name].items():
            estimate = effect.parameters[name]
            assert estimate.value == value or abs(float(estimate.value) - value) < max(4 * estimate.std, 0.02)


def test_the_command_and_its_report(tmp_path: Path, command: Callable[..., Any]) -> None:
    captures = replace(snapshots({"mask_contrast": {"leak": 0.2}}, 4), verification=(3,))
    write_captures(tmp_path / "a.h5", captures)
    kept = ",".join(name for name in vocabulary() if name not in ("mask_contrast", "shot_noise", "read_noise", "gain"))
    done = command("diagnose", f"captures={tmp_path}/a.h5", f"out={tmp_path}/out", f"leave_out=[{kept}]")
    assert "the diagnosis is blind" in done.stdout and "unknown scenes cannot tell: gain" in done.stdout
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    check("report", report)
    assert report["mode"] == "blind" and [effect["name"] for effect in report["effects"]] == ["mask_contrast"]
    assert report["undetermined"] == [{"effect": "gain", "looks_like": "the brightness of the scenes"}]
    verification = report["verification"]
    assert verification["captures"] == [3] == report["split"]["held_out_captures"]
    assert report["effects"][0]["evidence"]["agree"] == [3, 3]
    assert verification["prediction_error"] < verification["before"]["prediction_error"]
    assert "MaskContrast" in (tmp_path / "out" / "encoder.yaml").read_text()
    assert "What unknown scenes cannot tell" in (tmp_path / "out" / "report.html").read_text()


def test_no_picture_is_left_of_an_earlier_report(tmp_path: Path) -> None:
    for hidden in ({"mask_contrast": {"leak": 0.2}}, {}):
        with report_folder(tmp_path) as folder:
            write_report(diagnosed(snapshots(hidden, 3, size=(48, 48)), ("mask_contrast",)), folder)
        assert (tmp_path / "prediction.png").is_file() == (tmp_path / "reconstruction.png").is_file() == bool(hidden)
    assert (tmp_path / "report.html").is_file()


@pytest.mark.slow
def test_one_snapshot_says_so_and_is_less_sure() -> None:
    hidden = {"mask_contrast": {"leak": 0.2}}
    one, six = (diagnosed(snapshots(hidden, count, size=(48, 48)), ("mask_contrast",)) for count in (1, 6))
    assert any("uncertainties are widened" in note for note in one.notes)
    assert not any("widened" in note for note in six.notes)
    (alone,), (together,) = one.effects, six.effects
    assert alone.parameters["leak"].std > 1.5 * together.parameters["leak"].std


def test_saturated_blocks_are_left_out_and_say_so() -> None:
    captures = snapshots({"mask_contrast": {"leak": 0.2}})
    bright = np.minimum(captures.measurement.astype(float) * 1.6, 255).astype(np.uint8)
    result = diagnosed(replace(captures, measurement=bright), ("mask_contrast",))
    assert any("saturated pixel" in note for note in result.notes) and result.names == ("mask_contrast",)


def test_two_slots() -> None:
    result = diagnosed(snapshots({"mask_contrast": {"leak": 0.2}}, frames=2, aperture=0.45), ("mask_contrast",))
    assert result.names == ("mask_contrast",)


def test_no_texture_names_nothing() -> None:
    """Snapshots in which no mask is to be seen: the same everywhere but for noise."""
    captures = snapshots(count=3)
    random = np.random.default_rng(0)
    even = np.round(random.normal(100, 1, captures.measurement.shape)).astype(np.uint8)
    result = diagnosed(replace(captures, measurement=even), ("mask_contrast", "pattern_order"))
    assert not result.names and result.verdict == "undecided" and "No mask is to be seen" in result.notes[0]


def compared(before: float, after: float, p_value: float) -> PairedComparison:
    return PairedComparison(before, after, ((before, after),), p_value, agree=1, snapshots=1, blocks=100)


@pytest.mark.parametrize(
    ("without_mask", "verification", "verdict"),
    [
        (compared(0.9, 0.5, 1e-6), None, "explained"),
        (compared(0.9, 0.5, 1e-6), compared(0.7, 0.5, 1e-6), "explained"),
        (compared(0.9, 0.5, 1e-6), compared(0.5, 0.7, 1.0), "partly_explained"),
        (compared(0.5, 0.5, 0.4), compared(0.7, 0.5, 1e-6), "undecided"),
    ],
)
def test_held_out_pixels_have_a_veto(
    without_mask: PairedComparison, verification: PairedComparison | None, verdict: str
) -> None:
    diagnosis = diagnosed(snapshots({"mask_contrast": {"leak": 0.2}}, 3, size=(24, 24)), ("mask_contrast",))
    gap = compared(0.7, 0.5, 1e-6)
    judged = PredictionVerdict(gap, dict.fromkeys(diagnosis.names, gap), without_mask, verification)
    assert diagnosis.names == ("mask_contrast",) and replace(diagnosis, prediction=judged).verdict == verdict


def test_a_camera_without_a_mask_is_as_good() -> None:
    """Whatever weakens a wrong mask makes snapshots likelier, and would make reconstructions worse: nothing is decided.

    That is so if held-out pixels do not need the mask, and if the likelihood hardly needs it.
    """
    diagnosis = diagnosed(snapshots({"mask_contrast": {"leak": 0.2}}, 3, size=(24, 24)), ("mask_contrast",))
    assert diagnosis.mask.decides and diagnosis.verdict == "explained"
    gap = compared(0.7, 0.5, 1e-6)
    judged = PredictionVerdict(gap, {"mask_contrast": gap}, compared(0.5, 0.5, 0.4))
    weak, chance = MaskEvidence(0.219, 0.208, 0.1, distinct=True), MaskEvidence(0.0, -0.2, 0.1, distinct=False)
    for changed in ({"prediction": judged}, {"mask": weak}, {"mask": chance}):
        undecided = replace(diagnosis, notes=("A camera without any mask", "Further"), **changed)
        assert undecided.verdict == "undecided" and undecided.hypothesis == diagnosis.ideal.hypothesis
        sentence = headline(undecided)
        assert sentence.startswith("A camera without any mask The likeliest camera: closed mirrors let through")
        assert further_notes(undecided) == ("Further",)
        report = describe(undecided)
        check("report", report)
        assert report["verdict"] == "undecided" and report["without_mask"]["gained"] == undecided.mask.gained_without


def test_reports_of_earlier_versions_still_open() -> None:
    report = describe(diagnosed(snapshots({}, 3, size=(24, 24)), ("mask_contrast",)))
    assert report["format_version"] == 3 and report["without_mask"]["gained_with_mask"] == 0
    check(
        "report",
        {key: report[key] for key in report if key not in ("without_mask", "calibration")} | {"format_version": 2},
    )


@pytest.mark.slow
def test_contrast_and_curve_of_a_measured_mask_are_its_calibration() -> None:
    """Nobody knows them, so that they are fitted and never named; what is wrong beside them is."""
    captures = snapshots({"mask_shift": {"dx": 0.7, "dy": -0.4}}, size=(48, 48))
    random = np.random.default_rng(0)
    gray = (0.15 + 0.7 * captures.patterns + random.uniform(0, 0.1, captures.patterns.shape)).astype(np.float32)
    result = diagnosed(replace(captures, patterns=gray), (*FEW, "mask_level_gamma"))
    assert result.names == ("mask_shift",) and result.calibration.keys() == {"mask_contrast", "mask_level_gamma"}
    assert any("was measured" in note for note in result.notes)
    assert not diagnosed(captures).calibration
    content = describe(result)
    check("report", content)
    assert content["calibration"]["mask_level_gamma"]["gamma"]["value"] > 1.2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"patterns": 0}, "never open"),
        ({"measurement": 0}, "every snapshot is black or without detail"),
        ({"measurement": 255}, "saturated"),
    ],
)
def test_bad_input(change: dict[str, int], message: str) -> None:
    captures = snapshots(count=2, size=(24, 24))
    arrays = {name: np.full_like(getattr(captures, name), value) for name, value in change.items()}
    with pytest.raises(BadInput, match=message):
        diagnosed(replace(captures, **arrays))


def test_settings_of_known_scenes_are_refused() -> None:
    with pytest.raises(BadInput, match=r"search\.max_unnamed=2: .*indistinct_nats"):
        diagnose_blind(snapshots(count=1), settings=SearchSettings(min_gain_nats=1.0, max_unnamed=2))


def test_a_weak_delay_is_undetermined_unless_it_is_named() -> None:
    result = diagnosed(snapshots({}, 3, size=(48, 48)), ("gain", "sync_offset"))
    assert result.names == () and result.undetermined.keys() == {"gain", "sync_offset"}
    assert "move a little less" in result.undetermined["sync_offset"]
