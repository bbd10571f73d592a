"""Fewer codes, evenly from 0 to full scale, each written as the nearest DN."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import BitDepth
from sci_lightning.errors import BadInput
from tests.encoder.effects.conftest import encoder


def test_codes() -> None:
    ramp = torch.linspace(0, 1, 1001)[None, None].expand(2, 1, 1001) / 2
    camera = encoder(BitDepth(bits=2), pattern=torch.ones(2, 1, 1001), bits=8)
    codes = camera(ramp[None])[0, 0] * 255
    assert codes.round().unique().tolist() == [0, 85, 170, 255]
    changes = codes.diff().nonzero().flatten() / 1000
    torch.testing.assert_close(changes, torch.tensor([1, 3, 5]) / 6, rtol=0, atol=2e-3)
    three = encoder(BitDepth(bits=3), pattern=torch.ones(2, 1, 1001), bits=8)(ramp[None])[0, 0] * 255
    torch.testing.assert_close(three, three.round())  # 255 / 7 is no whole number: the nearest DN


def test_no_more_than_the_converter_has() -> None:
    light = torch.rand(1, 2, 1, 99) / 2
    finer = encoder(BitDepth(bits=12), pattern=torch.ones(2, 1, 99), bits=8)(light)
    assert torch.equal(finer, encoder(pattern=torch.ones(2, 1, 99), bits=8)(light))


def test_a_sensor_without_bits_is_refused() -> None:
    with pytest.raises(BadInput, match=r"leaves 5 bits.*clip_quantise"):
        encoder(BitDepth(bits=5))
