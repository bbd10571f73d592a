"""Gaps between mirrors: found by their size where the mask's image is displaced, kept by the encoder, never a name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.search.evidence import imperfections_in
from sci_lightning.encoder.effects import FillFactor
from tests.diagnosis.fit.small_fit import NOISE, fitter

FRACTION, TURNED = 0.9, {"mask_rotation": {"angle": 0.8}}


def test_a_turned_mask_shows_the_gaps(tmp_path: Path) -> None:
    """The captures are those of touching mirrors; what is recorded is put in their place, gaps and noise included."""
    subject = fitter(tmp_path, TURNED)
    turned = NOISE.with_effect("mask_rotation", TURNED["mask_rotation"])
    truth = subject.model.predict(turned.with_effect("fill_factor", {"fraction": FRACTION}))
    noise = truth.deviation * torch.randn(truth.mean.shape, generator=torch.Generator().manual_seed(1))
    seen = subject.model.observation
    recorded = seen.dn.clone().float()
    rows, columns = subject.model.window
    recorded[:, rows, columns] = (truth.mean + noise).round().clamp(0, seen.full_scale)
    gaps = type(subject)(CameraModel(replace(seen, dn=recorded.to(seen.dn)), subject.model.vocabulary), subject.split)
    start = turned.with_effect("fill_factor", {"fraction": FillFactor.about["fraction"].starts[0] + 0.05})
    fit = gaps.fit(start, iterations=20)
    (found,) = imperfections_in(fit)
    assert found.name == "fill_factor" and fit.hypothesis.effects["mask_rotation"]["angle"] == pytest.approx(0.8, 1e-2)
    assert found.parameters["fraction"].value == pytest.approx(FRACTION, abs=0.01)
