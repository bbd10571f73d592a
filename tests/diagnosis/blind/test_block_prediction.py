"""Held-out pixels, predicted from their blocks, confirm the right camera and contradict a wrong one."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.diagnosis.blind.block_prediction import BlockPredictor, predict_by_blocks
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import ScenePrior, statistics_for
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, datasheet_noise
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.effects import MaskContrast
from tests.diagnosis.blind.conftest import snapshots

BLUR = {"mask_blur": {"sigma": 0.8}}


def likelihood_of(frames: int) -> tuple[BlindLikelihood, Hypothesis]:
    """Three snapshots of a camera whose mask is blurred, and the ideal camera."""
    observation = observe_snapshots(snapshots(BLUR, frames=frames, side=64, count=3))
    model = CameraModel(observation, vocabulary(), {"mask_contrast": MaskContrast})
    prior = ScenePrior(frames, statistics_for(frames, observation.patterns))
    return BlindLikelihood(model, prior), datasheet_noise(observation)[0]


@pytest.mark.parametrize("frames", [4, 18])
def test_errors(frames: int) -> None:
    likelihood, noise = likelihood_of(frames)
    blurred = noise.with_effect("mask_blur", BLUR["mask_blur"])
    predictor = BlockPredictor(likelihood, likelihood.inside(likelihood.model.border(blurred)), folds=2)
    right = predictor.errors(blurred)
    wrong = predictor.errors(noise)
    flat = predictor.errors(noise.with_effect("mask_contrast", {"leak": 1.0}))
    assert (
        right.squared.shape == (3, 64, 64) and 580 < right.squared.isfinite().sum() < 800
    )  # a tenth of 36 blocks in three snapshots
    assert torch.equal(right.squared.isnan(), wrong.squared.isnan())
    assert right.prediction_error < 0.9 * flat.prediction_error
    assert right.prediction_error < 0.9 * wrong.prediction_error


def test_the_verdict() -> None:
    likelihood, noise = likelihood_of(4)
    right = noise.with_effect("mask_blur", BLUR["mask_blur"])
    weak = right.with_effect("mask_contrast", {"leak": 0.5})
    verdict = predict_by_blocks(likelihood, noise, weak, ("mask_blur", "mask_contrast"), verification=[1])
    assert verdict.by_effect["mask_contrast"].fall < 0 and "mask_contrast" in verdict.contradicted()
    verdict = predict_by_blocks(likelihood, noise, right, ("mask_blur",), verification=[1])
    assert verdict.contradicted() == () and verdict.mask_helps()
    assert verdict.verification is not None and verdict.verification.snapshots == 1
