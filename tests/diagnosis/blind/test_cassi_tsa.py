"""Real snapshots with a calibrated mask: its image is blurred, which no displacement explains (docs/results)."""

from __future__ import annotations

from pathlib import Path

import pytest

from sci_lightning.captures.snapshots import captures_of_snapshots, matching_files, read_snapshots
from sci_lightning.diagnosis.blind.paired_comparison import compare
from sci_lightning.diagnosis.blind.prediction import Predictor
from sci_lightning.diagnosis.blind.search_by_prediction import PredictionSettings, search_by_prediction
from sci_lightning.diagnosis.blind.snapshot_camera import SnapshotCamera, snapshots_of
from sci_lightning.diagnosis.vocabulary import vocabulary

SCENES = (3, 4)
"""Snapshots that only verify: nothing was fitted to them."""


def cassi(shared_data: Path, side: int) -> SnapshotCamera:
    """A square of the field around its centre, as a camera of its own."""
    folder = shared_data / "real" / "cassi_tsa"
    dn, bits = read_snapshots(matching_files(folder / "scene*.mat"))
    assert bits == 12 and dn.shape == (5, 660, 714)
    captures = captures_of_snapshots(dn, bits, folder / "mask.mat", step=(0, 2), verification=SCENES)
    part = slice(336 - side // 2, 336 + side // 2)
    return snapshots_of(captures, vocabulary()).window(part, part)


def test_a_blurred_mask_predicts_better(shared_data: Path) -> None:
    camera = cassi(shared_data, 88)
    camera = camera.take(camera.verification)
    window = (slice(12, 76), slice(12, 76))
    predictor = Predictor(camera.measurement, folds=1, window=window)
    ideal, blurred, displaced = (
        predictor.errors(camera.encoder(effects))
        for effects in ({}, {"mask_blur": {"sigma": 0.8}}, {"mask_shift": {"dx": 0.35, "dy": 0.0}})
    )
    better = compare(ideal, blurred)
    assert better.agree == 2 and better.p_value < 1e-3
    for before, after in better.by_capture:  # 30 % on larger parts: a frame is seen over 54 columns
        assert after < 0.85 * before
    assert compare(displaced, blurred).fall > 0.03


@pytest.mark.slow
def test_the_search_names_it(shared_data: Path) -> None:
    """Scenes 1 to 3 are fitted, 4 and 5 verify: mask_blur is named first, and no displacement above 0.1 pixel."""
    settings = PredictionSettings(window=96, window_folds=1, folds=2, most=1, finest=0.2)
    result = search_by_prediction(cassi(shared_data, 160), settings=settings)
    assert [effect.name for effect in result.effects] == ["mask_blur"]
    assert result.verification is not None and result.verification.agree == 2
    for before, after in result.verification.by_capture:
        assert after < 0.7 * before
    assert "mask_shift" not in result.effects[0].alternatives
