"""The mask's image is blurred, the scene is not."""

from __future__ import annotations

import math

import pytest
import torch

from sci_lightning.encoder import relay
from sci_lightning.encoder.effects import MaskBlur
from sci_lightning.encoder.footprint import square_kernel
from sci_lightning.encoder.relay import RelayGeometry
from tests.encoder.effects.conftest import seen


def test_squares_blurred_and_collected() -> None:
    pattern = torch.zeros(2, 9, 9)
    pattern[0, 4, 4] = 1
    result = seen(MaskBlur(sigma=0.8), pattern)
    assert result.sum() == pytest.approx(1, abs=1e-3)
    across = result.sum(0)
    spread = float((across * (torch.arange(9) - 4) ** 2).sum())
    assert spread == pytest.approx(0.8**2 + 2 / 12, rel=1e-2)  # of the blur, a mirror and a pixel
    torch.testing.assert_close(result, result.T)


def test_the_scene_stays_sharp() -> None:
    scene = torch.rand(2, 9, 9)
    even = torch.full((2, 9, 9), 0.5)
    result = seen(MaskBlur(sigma=0.8), even, scene)[4, 4]
    assert result == pytest.approx(float(scene[:, 4, 4].sum() / 2), abs=1e-3)


@pytest.mark.parametrize("sigma", [0.05, 0.3, 2.0])
def test_a_blurred_image_that_is_turned(sigma: float) -> None:
    """The kernel is computed at some places between two mirrors; the light of a mirror is that of the exact one."""
    angle, size = 0.02, 25
    pattern = torch.zeros(1, size, size, dtype=torch.float64)
    pattern[0, 12, 14] = 1
    options = {"angle": torch.tensor(angle), "sigma": torch.tensor(sigma, dtype=torch.float64)}
    image = RelayGeometry(**options).image(pattern)[0]
    place = (torch.arange(2 * size, dtype=torch.float64) + 0.5) / 2 - size / 2
    down = math.cos(angle) * place[:, None] - math.sin(angle) * place
    across = math.cos(angle) * place + math.sin(angle) * place[:, None]
    exact = square_kernel(down, options["sigma"], 0.5) * square_kernel(across - 2, options["sigma"], 0.5)
    whole = torch.nn.functional.avg_pool2d(exact[None], 2)[0]
    assert torch.allclose(image, whole, atol=3e-5)  # what lies beyond four standard deviations is cut off
    assert float((image - whole).abs()[whole > 1e-2].max()) < 3e-6


def test_a_wide_blur_makes_the_footprint_of_a_pixel_irrelevant(monkeypatch: pytest.MonkeyPatch) -> None:
    """From :data:`SMOOTH_BLUR` on, a pixel that sees the mirrors turned is not divided, and hardly differs."""
    pattern = (torch.rand(1, 48, 48, dtype=torch.float64, generator=torch.Generator().manual_seed(0)) > 0.5).double()
    poses = ({"angle": 0.035}, {"tilt_x": 0.02, "tilt_y": 0.01}, {"k": 0.02})
    for values, limit in zip(poses, (1e-4, 5e-4, 5e-4), strict=True):
        geometry = RelayGeometry(
            **{key: torch.tensor(one, dtype=torch.float64) for key, one in (*values.items(), ("sigma", 1.0))}
        )
        undivided = geometry.image(pattern)[0, 8:-8, 8:-8]
        monkeypatch.setattr(relay, "SMOOTH_BLUR", 9.0)
        monkeypatch.setattr(relay, "TURNED_PARTS", 8)
        divided = geometry.image(pattern)[0, 8:-8, 8:-8]
        monkeypatch.undo()
        difference = float((undivided - divided).square().mean().sqrt() / divided.std())
        assert 0 < difference < limit


@pytest.mark.parametrize("sigma", [0.0, 1.5])
@pytest.mark.parametrize("values", [{"angle": 0.02}, {"k": 0.02}, {"tilt_x": 0.02, "tilt_y": 0.0}, {"dx": 0.3}])
def test_a_part_of_an_image_is_that_of_the_whole(values: dict[str, float], sigma: float) -> None:
    pattern = torch.rand(2, 20, 24)
    wanted = torch.rand(20, 24) > 0.7
    geometry = RelayGeometry(**{key: torch.tensor(one) for key, one in (*values.items(), ("sigma", sigma))})
    whole, part = geometry.image(pattern), geometry.image(pattern, wanted=wanted)
    torch.testing.assert_close(part[:, wanted], whole[:, wanted])
    if geometry.turned:
        assert not part[:, ~wanted].any()
        assert not geometry.image(pattern, wanted=torch.zeros_like(wanted)).any()
