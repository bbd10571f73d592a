"""The contract of every sensor in the configuration; clipping, rounding, noise."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput
from tests.conftest import members


@pytest.mark.parametrize("name", members("encoder/sensor"))
def test_contract(name: str, configuration: Callable[..., DictConfig]) -> None:
    sensor = instantiate(configuration("train", f"encoder/sensor={name}").encoder.sensor)
    light = torch.rand(2, 5, 7, requires_grad=True)
    measurement = sensor(light)
    assert measurement.shape == light.shape
    assert torch.allclose(measurement, light, atol=1 / 255)
    measurement.sum().backward()
    assert torch.equal(light.grad, torch.ones_like(light))


@pytest.mark.parametrize("bit_depth", [1, 8, 12, 16])
def test_levels_and_halves(bit_depth: int) -> None:
    full = 2**bit_depth - 1
    sensor = ClipQuantise(bit_depth)
    light = torch.tensor([-0.5, 0.0, 0.5 / full, 0.49 / full, 1.0, 1.7], dtype=torch.float64)
    assert (sensor(light) * full).round().tolist() == [0, 0, 1, 0, full, full]
    values = sensor(torch.rand(1000, dtype=torch.float64)) * full
    assert torch.allclose(values, values.round(), atol=1e-9)


def test_gradient_of_clipping_is_its_own() -> None:
    light = torch.tensor([-0.2, 0.3, 0.8, 1.3], requires_grad=True)
    ClipQuantise()(light).sum().backward()
    assert light.grad.tolist() == [0, 1, 1, 0]


def test_shot_noise_has_the_variance_of_photons() -> None:
    sensor = ClipQuantise(bit_depth=16, full_well=1000)
    for level in (0.05, 0.5):
        values = sensor(torch.full((400, 400), level))
        assert abs(float(values.mean()) - level) < 2e-4
        assert abs(float(values.var()) / (level / 1000) - 1) < 0.03
    assert float(sensor(torch.zeros(10, 10)).max()) == 0


def test_read_noise_is_in_steps_of_the_converter() -> None:
    values = ClipQuantise(bit_depth=8, read_noise=2.0)(torch.full((500, 500), 0.5)) * 255
    assert abs(float(values.std()) - (2.0**2 + 1 / 12) ** 0.5) < 0.02


def test_noise_keeps_gradients_finite_in_the_dark() -> None:
    light = torch.zeros(50, 50, requires_grad=True)
    ClipQuantise(full_well=5000, read_noise=1)(light).sum().backward()
    assert torch.isfinite(light.grad).all()


@pytest.mark.parametrize(
    "arguments", [{"bit_depth": 0}, {"bit_depth": 17}, {"bit_depth": 8.0}, {"full_well": 0}, {"read_noise": -1}]
)
def test_out_of_range(arguments: dict[str, float]) -> None:
    with pytest.raises(BadInput, match=next(iter(arguments))):
        ClipQuantise(**arguments)  # type: ignore[arg-type]
