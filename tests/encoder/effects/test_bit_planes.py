"""Gray levels are binary planes one after the other, between which the scene moves."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import BitPlanes, MaskContrast
from sci_lightning.encoder.light_path import LightPath
from tests.encoder.effects.conftest import seen, video

SCENE = video(1)[0]
LEVELS = torch.randint(0, 16, SCENE.shape, generator=torch.Generator().manual_seed(3))


@pytest.mark.parametrize("full", [15, 16])
@pytest.mark.parametrize(("order", "begins"), [("msb_first", (14, 12, 8, 0)), ("lsb_first", (0, 1, 3, 7))])
def test_plane_by_plane(order: str, begins: tuple[int, ...], full: int) -> None:
    change = torch.stack((SCENE[1] - SCENE[0], *((SCENE[2:] - SCENE[:-2]) / 2), SCENE[-1] - SCENE[-2]))
    expected = torch.zeros(SCENE.shape[1:])
    for bit, begin in enumerate(begins):
        middle = (begin + 2**bit / 2) / 15  # of the slot
        plane = ((LEVELS >> bit) & 1) * 2**bit / full
        expected += (plane * (SCENE + (middle - 0.5) * change)).sum(0)
    torch.testing.assert_close(seen(BitPlanes(order=order), LEVELS / full, SCENE), expected, rtol=0, atol=1e-6)


def test_open_mirrors_are_open_all_the_time() -> None:
    told = torch.cat((LEVELS[:-1] / 16, torch.ones_like(LEVELS[:1])))  # 1 is no level of 4 bits that ends at 15 / 16
    effective = LightPath([BitPlanes(order="msb_first")]).transmittance(told)
    without = LightPath([BitPlanes(order="msb_first")]).transmittance(torch.cat((LEVELS[:-1] / 16, 0 * told[:1])))
    torch.testing.assert_close(effective[:-1], without[:-1], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("told", "scene"),
    [
        pytest.param((LEVELS > 7).float(), SCENE, id="binary"),
        pytest.param(LEVELS / 16, SCENE[:1].expand(4, -1, -1), id="at rest"),
        pytest.param(0.37 * LEVELS / 16 + 0.1234, SCENE, id="no levels"),
    ],
)
def test_it_does_nothing(told: torch.Tensor, scene: torch.Tensor) -> None:
    planes = seen(BitPlanes(order="lsb_first"), told, scene)
    torch.testing.assert_close(planes, (told * scene).sum(0), rtol=0, atol=2e-6)


def test_no_pixel_receives_less_than_no_light() -> None:
    told, scene = torch.zeros(2, 2, 2), torch.zeros(2, 2, 2)
    told[0], scene[1] = 1 / 4, 1.0  # the scene lights up after the only open slot, in whose middle it is dark
    told[1, 0, 0] = 1 / 2  # so that there are two bits
    assert (seen(BitPlanes(order="lsb_first"), told, scene)[0, 1:] == 0).all()
    assert (seen(BitPlanes(order="msb_first"), told, scene)[0, 1:] > 0).all()


def test_planes_leak_as_all_patterns_do() -> None:
    path = LightPath([BitPlanes(order="msb_first"), MaskContrast(leak=0.2)])
    own = LightPath([BitPlanes(order="msb_first")]).transmittance(LEVELS / 16)
    torch.testing.assert_close(path.transmittance(LEVELS / 16), 0.2 + 0.8 * own, rtol=0, atol=1e-6)
