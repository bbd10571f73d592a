"""The contract of every encoder in the configuration: the forward model, the aperture, bad shapes."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import RandomBinary, RandomStructural
from sci_lightning.encoder.sensor import ClipQuantise, Ideal
from sci_lightning.errors import BadInput
from tests.conftest import members


@pytest.mark.parametrize("name", members("encoder"))
@pytest.mark.parametrize("frames", [4, 8])
def test_contract(name: str, frames: int, configuration: Callable[..., DictConfig]) -> None:
    encoder = instantiate(configuration("train", f"encoder={name}", f"frames={frames}", "size=[20,24]").encoder)
    video = torch.rand(3, frames, 20, 24)
    measurement = encoder(video)
    assert measurement.shape == (3, 20, 24)
    expected = encoder.aperture * (video * encoder.mask()).sum(1)
    if isinstance(encoder.sensor, ClipQuantise):
        expected = expected.clamp(0, 1)
        assert torch.allclose(measurement * 255, (measurement * 255).round(), atol=1e-4)
    assert torch.allclose(measurement, expected, atol=0.5 / 255 + 1e-6)
    assert torch.allclose(encoder.normalised(measurement) * encoder.aperture, measurement)
    assert torch.equal(measurement, encoder(video))
    still = torch.full((1, frames, 20, 24), 0.5)
    if encoder.aperture == 1 and "sw" in name:  # structural: a motionless scene is recorded as it is
        assert torch.allclose(encoder(still), still[:, 0], atol=0.5 / 255 + 1e-6)


def test_papers_encoders(configuration: Callable[..., DictConfig]) -> None:
    built = {name: instantiate(configuration("train", f"encoder={name}").encoder) for name in members("encoder")}
    assert isinstance(built["rbw_osr"].sensor, Ideal) and built["rbw_osr"].aperture == 1
    assert isinstance(built["rbw_sr"].sensor, ClipQuantise) and built["rbw_sr"].aperture == 2 / 8
    assert torch.equal(built["rbw_sr"].mask(), built["rbw_osr"].mask())
    assert built["lsw_sr"].mask.learned and built["lsw_sr"].aperture == 1 and built["lsw_sr"].mask.bits == 4
    assert not built["rsw_sr"].mask.learned and built["rsw_sr"].aperture == 1


def test_aperture_is_set_by_a_number() -> None:
    assert Encoder(RandomBinary(8, (4, 4)), Ideal(), aperture=0.3).aperture == 0.3
    for wrong in (0, -1, "wide"):
        with pytest.raises(BadInput, match="aperture"):
            Encoder(RandomBinary(8, (4, 4)), Ideal(), aperture=wrong)


@pytest.mark.parametrize("shape", [(2, 8, 16, 17), (2, 7, 16, 16), (8, 16, 16)])
def test_video_that_does_not_fit_the_mask(shape: tuple[int, ...]) -> None:
    encoder = Encoder(RandomStructural(4, 8, (16, 16)), ClipQuantise())
    with pytest.raises(BadInput, match=r"must agree|N of videos"):
        encoder(torch.rand(shape))
