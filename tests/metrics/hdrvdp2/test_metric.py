"""The Q-Score as a torchmetrics metric."""

from __future__ import annotations

import doctest

import pytest
import torch

from sci_lightning.errors import BadInput
from sci_lightning.metrics import HDRVDP2, hdrvdp2_q
from sci_lightning.metrics.hdrvdp2 import quality as module


def images(*shape: int) -> tuple[torch.Tensor, torch.Tensor]:
    truth = torch.rand(shape)
    return (truth + 0.05 * torch.randn(shape)).clamp(min=0), truth


def test_example() -> None:
    result = doctest.testmod(module)
    assert result.attempted > 0 and result.failed == 0


@pytest.mark.parametrize("shape", [(24, 30), (3, 24, 30), (2, 3, 24, 30), (2, 2, 2, 24, 30)])
def test_any_axes_before_grey_frames(shape: tuple[int, ...]) -> None:
    estimate, truth = images(*shape)
    metric = HDRVDP2(pixels_per_degree=40)
    metric.update(estimate, truth)
    expected = hdrvdp2_q(estimate.reshape(-1, 24, 30), truth.reshape(-1, 24, 30), pixels_per_degree=40)
    assert metric.frames == len(expected)
    assert float(metric.compute()) == pytest.approx(float(expected.mean()))


@pytest.mark.parametrize(("shape", "frames"), [((4, 24, 30), 4), ((2, 3, 24, 30), 2), ((2, 4, 3, 24, 30), 8)])
def test_colour_frames(shape: tuple[int, ...], frames: int) -> None:
    metric = HDRVDP2("sRGB-display")
    metric.update(*images(*shape))
    assert metric.frames == frames
    with pytest.raises(BadInput, match="must be"):
        metric.update(*images(2, 4, 24, 30))


def test_negative_estimates() -> None:
    estimate, truth = images(2, 24, 30)
    estimate[0, :5] = -0.1
    with pytest.raises(BadInput, match="negative"):
        HDRVDP2().update(estimate, truth)
    metric = HDRVDP2(clip_negative=True)
    metric.update(estimate, truth)
    assert float(metric.compute()) == pytest.approx(float(hdrvdp2_q(estimate.clamp(min=0), truth).mean()))
    with pytest.raises(BadInput, match="reference has negative"):
        metric.update(truth, estimate)
    assert "below 0" in metric.convention and "below 0" not in HDRVDP2().convention


def test_convention() -> None:
    metric = HDRVDP2("sRGB-display", 52.7)
    assert metric.higher_is_better and metric.is_differentiable
    for part in ("2.2.2", "sRGB-display", "52.7 pixels per degree", "per frame", "mean over frames", "over scenes"):
        assert part in metric.convention


@pytest.mark.parametrize("arguments", [{"encoding": "sRGB"}, {"pixels_per_degree": 0}, {"pixels_per_degree": -1.0}])
def test_impossible_conventions_are_refused_at_once(arguments: dict[str, object]) -> None:
    with pytest.raises(BadInput):
        HDRVDP2(**arguments)  # type: ignore[arg-type]


def test_precision() -> None:
    estimate, truth = images(2, 24, 30)
    values = []
    for dtype in (torch.float64, torch.float32):
        metric = HDRVDP2(dtype=dtype)
        metric.update(estimate, truth)
        values.append(float(metric.compute()))
    assert values[0] != values[1] and values[0] == pytest.approx(values[1], abs=0.02)
