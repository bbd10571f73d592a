"""A search by prediction alone names what is hidden, names nothing where nothing is, and says how sure it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from sci_lightning.diagnosis.blind.search_by_prediction import PredictionSettings, search_by_prediction
from sci_lightning.diagnosis.blind.snapshot_camera import SnapshotCamera

SMALL = PredictionSettings(window=48, window_folds=1, folds=2, most=1, polished=2, finest=0.3)
NAMES = ("mask_blur", "mask_shift", "mask_contrast")


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.0, 0.8])
def test_blur(sigma: float, record: Callable[..., SnapshotCamera]) -> None:
    camera = record({"mask_blur": {"sigma": sigma}} if sigma else None, NAMES)
    camera = replace(camera, verification=torch.tensor([False, False, True]))
    result = search_by_prediction(camera, settings=SMALL)
    assert [effect.name for effect in result.effects] == (["mask_blur"] if sigma else [])
    assert result.verification is not None and result.verification.snapshots == 1 and result.fitted.snapshots == 2
    if sigma:
        (effect,) = result.effects
        assert effect.values["sigma"] == pytest.approx(sigma, abs=0.15)
        assert 0 < effect.deviation["sigma"] < 0.2
        assert result.verification.fall > 0.1 and effect.evidence.agree == 2
        assert "optical_blur" in effect.alternatives
    else:
        assert result.verification.fall == 0
