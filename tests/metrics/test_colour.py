"""Metrics of videos in colour: of every channel, and their mean."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.metrics import PSNR, psnr
from sci_lightning.metrics.colour import in_colour


def test_channels_and_their_mean() -> None:
    truth = torch.rand(3, 4, 16, 16)
    estimate = truth + torch.tensor([0.1, 0.01, 0.001]).view(3, 1, 1, 1)
    metrics = in_colour({"psnr": PSNR()})
    for metric in metrics.values():
        for part in (slice(0, 2), slice(2, 4)):
            metric.update(estimate[:, part], truth[:, part])
    scores = {name: float(metric.compute()) for name, metric in metrics.items()}
    assert scores == pytest.approx({"psnr": 40, "psnr_red": 20, "psnr_green": 40, "psnr_blue": 60}, abs=0.01)
    assert scores["psnr"] == pytest.approx(float(psnr(estimate, truth).mean()))
    assert metrics["psnr"].convention == "mean of red, green and blue" and not metrics["psnr_red"].convention
