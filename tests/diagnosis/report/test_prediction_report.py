"""The report of held-out pixels follows the schema, and its encoder and masks are the corrected camera."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import yaml
from scipy.io import loadmat

from sci_lightning.configuration.build import build
from sci_lightning.diagnosis.blind.paired_comparison import compare
from sci_lightning.diagnosis.blind.prediction import Predictor, default_decoder, effective_mask
from sci_lightning.diagnosis.blind.search_by_prediction import PredictedEffect, PredictionResult
from sci_lightning.diagnosis.blind.snapshot_camera import snapshots_of
from sci_lightning.diagnosis.report.prediction_report import prediction_headline, write_prediction_report
from sci_lightning.diagnosis.vocabulary import vocabulary
from tests.diagnosis.blind.conftest import snapshots
from tests.schemas.validation import check


def test_the_files(tmp_path: Path) -> None:
    camera = snapshots_of(snapshots({"mask_blur": {"sigma": 0.7}}, count=2, side=40), vocabulary())
    camera = replace(camera, verification=torch.tensor([False, True]))
    values = {"mask_blur": {"sigma": 0.7}}
    predictor = Predictor(camera.measurement, default_decoder(5), folds=1)
    before, after = (predictor.errors(camera.encoder(effects)) for effects in ({}, values))
    fitted, verified = (compare(before.take([n]), after.take([n])) for n in (0, 1))
    effect = PredictedEffect("mask_blur", values["mask_blur"], {"sigma": 0.03}, fitted, ("optical_blur",))
    flat = predictor.errors(camera.encoder({"mask_contrast": {"leak": 1.0}}))
    both, control = compare(before, after), compare(flat, after)
    result = PredictionResult((effect,), fitted, verified, both, ({"mask_blur": 0.2},), 0, control)
    write_prediction_report(result, camera, tmp_path)
    content = json.loads((tmp_path / "report.json").read_text())
    check("report", content)
    assert (
        content["mode"] == "blind" and content["verdict"] == "explained" and content["verification"]["captures"] == [1]
    )
    assert content["gap"]["after"]["prediction_error"] < content["gap"]["before"]["prediction_error"]
    assert content["effects"][0]["evidence"]["agree"] == [1, 1]
    assert "blurred (sigma 0.7" in prediction_headline(result, camera)
    assert {"prediction.png", "reconstruction.png", "report.html"} <= {path.name for path in tmp_path.iterdir()}
    mask = np.load(tmp_path / "effective_mask.npy")
    expected = effective_mask(camera.encoder(values)).numpy()
    assert np.allclose(mask, expected, atol=1e-6)
    assert np.allclose(loadmat(tmp_path / "effective_mask.mat")["mask"].transpose(2, 0, 1), expected, atol=1e-6)
    settings = yaml.safe_load((tmp_path / "encoder.yaml").read_text())
    settings["mask"]["file"] = str(tmp_path / settings["mask"]["file"])
    encoder = build(settings, "encoder")
    assert torch.allclose(encoder.transmittance(), torch.from_numpy(expected), atol=1e-6)
    nothing = replace(result, effects=())
    assert nothing.verdict == "consistent" and "ask for nothing" in prediction_headline(nothing, camera)
    unseen = replace(result, without_mask=compare(after, flat))
    assert unseen.verdict == "unexplained" and "without any mask" in prediction_headline(unseen, camera)
