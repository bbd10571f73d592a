"""Real snapshots with a calibrated mask that predicts worse than a blurred one, and worse than no mask at all."""

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


def test_a_weaker_mask_predicts_better(shared_data: Path) -> None:
    """A blur helps more than a displacement; but so does a mask without contrast, so that nothing is proven."""
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
    better = compare(ideal, blurred)
    assert better.agree == 2 and better.p_value < 1e-3
    for before, after in better.by_capture:
        assert after < 0.85 * before
    assert compare(displaced, blurred).fall > 0.03
    assert compare(flat, blurred).fall < 0.05


@pytest.mark.slow
def test_the_search_says_that_nothing_is_proven(shared_data: Path) -> None:
    settings = PredictionSettings(window=96, window_folds=1, folds=1, most=1, finest=0.2, polished=2)
    result = search_by_prediction(cassi(shared_data, 160), settings=settings)
    assert [effect.name for effect in result.effects] == ["mask_blur"]
    assert result.verdict == "unexplained" and not result.mask_is_visible
