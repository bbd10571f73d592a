"""The stages of the Q-Score, each against another way to compute it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import correlate

from sci_lightning.metrics.hdrvdp2 import steerable_pyramid as pyramid
from sci_lightning.metrics.hdrvdp2.eye import (
    band_sensitivity,
    filter_base,
    modulation_transfer,
    response,
    scatter,
    sensitivity,
)
from sci_lightning.metrics.hdrvdp2.quality import pool
from sci_lightning.metrics.hdrvdp2.transforms import imresize, precomputed

DOUBLE = torch.zeros((), dtype=torch.float64)


def test_filters() -> None:
    start, high, low = map(pyramid.round_filter, (pyramid.LOW_START, pyramid.HIGH_START, pyramid.LOW))
    assert [len(taps) for taps in (start, high, low)] == [9, 15, 17]
    for taps in (start, high, low):
        assert torch.equal(taps, taps.mT) and torch.equal(taps, taps.flip(0))
    assert [float(taps.sum()) for taps in (start, high, low)] == pytest.approx([1, 0, 2], abs=1e-6)
    oriented = pyramid.oriented_filters()
    assert oriented.shape == (4, 9, 9)
    assert torch.equal(oriented, -oriented.flip(1, 2))
    y, x = torch.meshgrid(*[torch.arange(9.0, dtype=torch.float64) - 4] * 2, indexing="ij")
    slopes = torch.stack([torch.stack([(taps * x).sum(), (taps * y).sum()]) for taps in oriented])
    angles = torch.rad2deg(torch.atan2(slopes[:, 1], slopes[:, 0])) % 180
    torch.testing.assert_close(angles, torch.tensor([0, 135, 90, 45], dtype=torch.float64), atol=1e-6, rtol=0)


@pytest.mark.parametrize("size", [(17, 17), (18, 65), (33, 48), (71, 40)])
def test_pyramid_is_correlation_with_mirrored_borders(size: tuple[int, int]) -> None:
    image = torch.randn(1, *size, dtype=torch.float64)
    result = pyramid.steerable_pyramid(image)
    assert len(result) == pyramid.levels(*size) + 2

    def correlated(image: np.ndarray, taps: torch.Tensor) -> np.ndarray:
        return correlate(image, taps.numpy(), mode="mirror")

    low = correlated(image[0].numpy(), pyramid.round_filter(pyramid.LOW_START))
    expected = [correlated(image[0].numpy(), pyramid.round_filter(pyramid.HIGH_START))[None]]
    for _ in range(pyramid.levels(*size)):
        expected.append(np.stack([correlated(low, taps) for taps in pyramid.oriented_filters()]))
        low = correlated(low, pyramid.round_filter(pyramid.LOW))[::2, ::2]
    for band, other in zip(result, [*expected, low[None]], strict=True):
        torch.testing.assert_close(band[0], torch.from_numpy(np.ascontiguousarray(other)), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("size", "count"), [((256, 256), 4), ((17, 500), 1), ((33, 33), 1), ((34, 34), 2), ((16, 99), 0)]
)
def test_levels(size: tuple[int, int], count: int) -> None:
    assert pyramid.levels(*size) == count


def test_optics_on_the_doubled_field() -> None:
    image = 1 + 99 * torch.rand(1, 1, 20, 31, dtype=torch.float64)
    field = torch.full((40, 62), 1e-5, dtype=torch.float64)
    field[:20, :31] = image[0, 0]
    down, across = (torch.fft.fftfreq(2 * n, dtype=torch.float64) * 30 for n in (20, 31))
    rho = torch.hypot(down[:, None], across)
    u, v = 0.99727370023777070, 0.061466549455263
    weights = zip((0.426 * u, 0.574 * u, (1 - u) * v, (1 - u) * (1 - v)), (0.028, 0.37, 37, 360), strict=True)
    transfer = sum(a * torch.exp(-b * rho) for a, b in weights)
    expected = torch.fft.ifft2(torch.fft.fft2(field) * transfer).real[:20, :31].clamp(1e-5, 1e10)
    torch.testing.assert_close(scatter(image, 30.0)[0, 0], expected, rtol=0, atol=1e-12)
    assert float(modulation_transfer(image, (40, 62), 30.0)[0, 0]) == pytest.approx(1, abs=1e-15)


def test_response_is_the_integral_of_the_sensitivity() -> None:
    light = np.logspace(-5, 5, 2048)
    joint = 30.162 * ((4.0627 / light) ** 1.6596 + 1) ** -0.2712
    away = np.log10(light / 1.1732)
    exponent, width = np.where(away > 0, 2.9899, 1.2167), np.where(away > 0, 0.5547, 1.1478)
    rod = 10**1.1414 * np.exp(-(np.abs(away) ** exponent) / width)
    cone = 0.5 * np.interp(np.minimum(2 * light, 1e5), light, np.maximum(joint - rod, 1e-3))
    for kind, s in (("cone", cone), ("rod", rod)):
        expected = 0.006894596 / 10**-2.4 * cumulative_trapezoid(s * np.log(10), np.log10(light), initial=0)
        np.testing.assert_allclose(response(DOUBLE, kind).numpy(), expected, rtol=1e-10, atol=1e-12)


def test_contrast_sensitivity() -> None:
    rho = torch.tensor([0.0, 1.0, 4.0, 30.0], dtype=torch.float64)
    result = sensitivity(rho, torch.tensor(2.0, dtype=torch.float64).log10())
    p1, p2, p3, p4 = 0.405782, 4.40602, 0.935314, 5.61425  # as fitted at 2 cd/m2
    expected = p4 * ((1 + (p1 * rho[1:]) ** p2) / (1 - torch.exp(-((rho[1:] / 7) ** 2))) ** p3) ** -0.5
    torch.testing.assert_close(result[1:], expected)
    assert result[0] == 0
    log_light = torch.linspace(-6, 6, 50, dtype=torch.float64)
    torch.testing.assert_close(band_sensitivity(4.0, log_light), sensitivity(rho[2], log_light), rtol=1e-2, atol=0)
    assert float(sensitivity(rho[2], log_light[-1])) == float(sensitivity(rho[2], log_light[-5]))


def test_the_base_band_passes_nothing_uniform() -> None:
    padding = torch.tensor([3.0, -2.0], dtype=torch.float64)[:, None, None, None]
    luminance = torch.full((2, 1, 1, 1), 50.0, dtype=torch.float64)
    filtered = filter_base(padding.expand(2, 1, 9, 13), 1.0, luminance, padding)
    torch.testing.assert_close(filtered, torch.zeros_like(filtered), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("old", "new"), [(40, 20), (20, 40), (25, 25), (101, 51), (51, 101)])
def test_imresize_keeps_straight_lines_straight(old: int, new: int) -> None:
    line = torch.arange(old, dtype=torch.float64).expand(3, old)
    result = imresize(line, (3, new))[0]
    expected = (torch.arange(new, dtype=torch.float64) + 0.5) * old / new - 0.5
    middle = slice(new // 4, new - new // 4)
    tolerance = 1e-9 if old % new == 0 or new % old == 0 else 1e-2  # odd ratios: weights only nearly sum to 1
    torch.testing.assert_close(result[middle], expected[middle], rtol=0, atol=tolerance * old)
    torch.testing.assert_close(imresize(line.mT, (new, 3))[:, 0], result)


def test_imresize_by_hand() -> None:
    """Keys' cubic with a = -0.5 at quarters: weights -7, 105, 35, -5 of 128 (and mirrored)."""
    line = torch.zeros(1, 8, dtype=torch.float64)
    line[0, 4] = 128
    result = imresize(line, (1, 16))[0]
    assert result[6:12].tolist() == pytest.approx([-9, 29, 111, 111, 29, -9])
    halved = imresize(line, (1, 4))[0]
    assert float(halved.sum()) == pytest.approx(64)


def test_pooling() -> None:
    squares = [torch.zeros(2, 1, 4, 4, dtype=torch.float64) for _ in range(2)]
    squares[0][1] = 1.0
    q = pool(squares, [30.0, 200.0])
    assert q[0] == 100
    assert float(q[1]) == pytest.approx(100 - 0.2832 * np.log((4 / 16 + 1e-12) / 1e-12))


def test_what_is_precomputed_is_made_once_for_each_device_and_precision() -> None:
    made = []

    @precomputed
    def value(n: int) -> torch.Tensor:
        made.append(n)
        return torch.ones(n, dtype=torch.float64)

    with torch.inference_mode():
        first = value(DOUBLE, 3)
    assert not first.is_inference() and value(DOUBLE, 3) is first
    assert value(DOUBLE.float(), 3).dtype == torch.float32
    value(DOUBLE, 4)
    assert made == [3, 3, 4]
