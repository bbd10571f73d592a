"""The camera that a report leaves for use elsewhere."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.report.corrected_camera import effective_mask, encoder_of
from sci_lightning.encoder.effects import MaskBlur, OpticalBlur
from sci_lightning.encoder.light_path import LightPath
from tests.diagnosis.blind.conftest import snapshots


def test_a_blur_of_the_lens_acts_on_the_mask() -> None:
    observation = observe_snapshots(snapshots())
    blurs = (OpticalBlur(sigma=0.8), MaskBlur(sigma=0.8))
    blurred, expected = (effective_mask(encoder_of(observation, LightPath([blur]))) for blur in blurs)
    inside = (slice(None), slice(6, -6), slice(6, -6))
    assert torch.allclose(blurred[inside], expected[inside], atol=0.03)
