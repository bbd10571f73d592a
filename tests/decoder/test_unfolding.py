"""GAP-net and ADMM-net: their iterations, with U-nets that only add a constant."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.decoder import ADMMNet, GAPNet
from sci_lightning.decoder.layers.unet import UNet
from sci_lightning.operator import SnapshotOperator

SIZE = (4, 12, 16)


def adding(decoder: GAPNet | ADMMNet, *constants: float) -> GAPNet | ADMMNet:
    """The decoder with U-net k as x + tanh(constant k)."""
    for unet, constant in zip(decoder.children(), constants, strict=True):
        assert isinstance(unet, UNet)
        torch.nn.init.zeros_(unet.conv_last.weight)
        torch.nn.init.constant_(unet.conv_last.bias, constant)
    return decoder


@pytest.mark.parametrize("kind", [GAPNet, ADMMNet])
@torch.no_grad()
def test_idle_unets_leave_the_projection(kind: type) -> None:
    mask, measurement = torch.rand(SIZE), torch.rand(2, *SIZE[1:])
    for video in adding(kind(4, 3, channels=(2, 2, 2)), 0, 0, 0).stages(measurement, mask):
        torch.testing.assert_close(SnapshotOperator(mask)(video), measurement)


@pytest.mark.parametrize("squared", [False, True])
@torch.no_grad()
def test_gap_iterations(squared: bool) -> None:
    mask, y = torch.rand(SIZE), torch.rand(2, *SIZE[1:])
    decoder = adding(GAPNet(4, 3, (2, 2, 2), squared), 0.1, 0.2, 0.3)
    weight = (mask**2).sum(0) if squared else mask.sum(0)
    x = mask * y[:, None]
    for constant, result in zip((0.1, 0.2, 0.3), decoder.stages(y, mask), strict=True):
        x = x + mask * ((y - (mask * x).sum(1)) / weight)[:, None]
        x = x + torch.tanh(torch.tensor(constant))
        torch.testing.assert_close(result, x)


@pytest.mark.parametrize("squared", [False, True])
@torch.no_grad()
def test_admm_iterations(squared: bool) -> None:
    mask, y = torch.rand(SIZE), torch.rand(2, *SIZE[1:])
    decoder = adding(ADMMNet(4, 3, channels=(2, 2, 2), squared=squared), 0.1, 0.2, 0.3)
    gammas = (0.5, 0.6, 0.7)
    decoder.load_state_dict({f"gamma{k + 1}": torch.tensor([gammas[k]]) for k in range(3)}, strict=False)
    weight = (mask**2).sum(0) if squared else mask.sum(0)
    theta = mask * y[:, None]
    b = torch.zeros_like(theta)
    for constant, gamma, result in zip((0.1, 0.2, 0.3), gammas, decoder.stages(y, mask), strict=True):
        x = theta + b + mask * ((y - (mask * (theta + b)).sum(1)) / (weight + gamma))[:, None]
        theta = x - b + torch.tanh(torch.tensor(constant))
        b = b - (x - theta)
        torch.testing.assert_close(result, theta)


def test_keys_are_the_published_ones() -> None:
    keys = set(GAPNet(8).state_dict())
    assert {"unet1.dconv_down1.d_conv.0.weight", "unet12.upsample1.0.bias", "unet12.conv_last.weight"} <= keys
    assert len(keys) == 12 * 26
    assert set(ADMMNet(8).state_dict()) == {key for key in keys if int(key.split(".")[0][4:]) < 10} | {
        f"gamma{k}" for k in range(1, 10)
    }
