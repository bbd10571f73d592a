"""Real snapshots whose mask, as it was calibrated, is sharper than the one in the camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
from sci_lightning.diagnosis.blind.held_out_pixels import compare_errors
from sci_lightning.diagnosis.blind.snapshots import SnapshotCamera, snapshots_of
from sci_lightning.diagnosis.blind.unknown_scenes import Predictor
from sci_lightning.diagnosis.vocabulary import vocabulary
from tests.diagnosis.cassi_tsa import read_cassi


def cassi(shared_data: Path, side: int) -> SnapshotCamera:
    """A square of the field around its centre, as a camera of its own."""
    part = slice(336 - side // 2, 336 + side // 2)
    return snapshots_of(read_cassi(shared_data / "real" / "cassi_tsa"), vocabulary()).window(part, part)


def test_a_weaker_mask_predicts_better(shared_data: Path) -> None:
    """By a decoder that knows little, a blur helps more than a displacement; but so does a mask without contrast."""
    camera = cassi(shared_data, 88)
    camera = camera.take(camera.verification)
    window = (slice(12, 76), slice(12, 76))
    predictor = Predictor(camera.measurement, folds=1, window=window)
    ideal, blurred, displaced, flat = (
        predictor.errors(camera.encoder(effects))
        for effects in (
            {},
            {"mask_blur": {"sigma": 0.8}},
            {"mask_shift": {"dx": 0.35, "dy": 0.0}},
            {"mask_contrast": {"leak": 1.0}},
        )
    )
    better = compare_errors(ideal, blurred)
    assert better.agree == 2 and better.p_value < 1e-3
    for before, after in better.by_capture:
        assert after < 0.85 * before
    assert compare_errors(displaced, blurred).fall > 0.03
    assert compare_errors(flat, blurred).fall < 0.05


@pytest.mark.slow
def test_the_mask_is_softer_than_in_its_file(shared_data: Path) -> None:
    """Smooth scenes make a softer mask more likely than the mask of the file, and than none, which is the control.

    A displacement by half a pixel softens a mask nearly as a blur does. Which of them is named depends on the part of
    the field; the other one is always among its alternatives.
    """
    captures = read_cassi(shared_data / "real" / "cassi_tsa")
    part = slice(272, 400)
    size = np.full((len(captures), 1, 1, 1), np.nan, np.float32)
    patterns, measurement = captures.patterns[:, part, part], captures.measurement[:, part, part]
    captures = replace(captures, patterns=patterns.copy(), measurement=measurement.copy(), scene=size)
    names = ("mask_blur", "mask_shift", "mask_contrast", "shot_noise", "read_noise")
    diagnosis = diagnose_blind(captures, {name: vocabulary()[name] for name in names})
    assert len(diagnosis.effects) == 1 and diagnosis.verdict == "explained" and diagnosis.mask_is_visible
    assert {"mask_blur", "mask_shift"} <= {diagnosis.effects[0].name, *diagnosis.effects[0].alternatives}
    assert diagnosis.prediction is not None and diagnosis.prediction.verification is not None
    assert all(after < 0.9 * before for before, after in diagnosis.prediction.verification.by_capture)
