"""The switch between fast kernels and plain formulas: both decode to the same, and each does what it says."""

from __future__ import annotations

import doctest
from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch.nn import functional as F

from sci_lightning.decoder import Decoder, STFormer
from sci_lightning.decoder.layers import kernels
from sci_lightning.decoder.layers.convolution import Conv3d
from sci_lightning.errors import BadInput
from tests.conftest import members
from tests.decoder.small import SMALL

WIDE = {
    "res2former": ["decoder.dim=64", "decoder.depths=[1,1]"],
    "stformer": ["decoder.dim=32", "decoder.units=1"],
    "revsci": ["decoder.blocks=1"],
}
"""Widths at which the kernels take other ways than at those of ``SMALL``."""

CASES = [(name, SMALL.get(name, [])) for name in members("decoder")] + list(WIDE.items())


@pytest.mark.parametrize(("name", "settings"), CASES, ids=lambda value: value if isinstance(value, str) else "")
@torch.no_grad()
def test_both_decode_to_the_same(
    name: str, settings: list[str], make_decoder: Callable[..., Decoder], monkeypatch: pytest.MonkeyPatch
) -> None:
    for size in (
        "layers.attention.ATTENTION_TOKENS",
        "birnat.POSITION_WEIGHTS",
        "denoiser.total_variation.TOTAL_VARIATION_PIXELS",
        "layers.winograd.WINOGRAD_TILES",
    ):
        monkeypatch.setattr(f"sci_lightning.decoder.{size}", 48)  # several blocks
    decoder = make_decoder(name, 4, *settings)
    for parameter in decoder.parameters():
        if parameter.numel() == 1:  # a gain that starts from 0 hides what stands before it
            parameter += 0.1
    mask = torch.rand(4, 18, 17)
    measurement = (mask * torch.rand(2, 4, 18, 17)).sum(1)
    video = decoder(measurement, mask)
    kernels.use(decoder, "plain")
    plain = decoder(measurement, mask)
    torch.testing.assert_close(video, plain, rtol=0, atol=2e-5 * float(plain.abs().max()))


@pytest.mark.parametrize(
    "name", ["res2former", pytest.param("stformer", marks=pytest.mark.slow), "revsci", "efficientsci", "e2e_cnn"]
)
def test_as_exact_in_bfloat16(name: str, make_decoder: Callable[..., Decoder]) -> None:
    """The kernels for bfloat16 lose no more of the result than the plain formulas in bfloat16 do."""
    decoder = make_decoder(name, 8, *WIDE.get(name, SMALL.get(name, [])))
    mask = torch.rand(8, 20, 24)
    measurement = (mask * torch.rand(1, 8, 20, 24)).sum(1)
    weights = list(decoder.parameters())

    def computed() -> list[torch.Tensor]:
        video = decoder(measurement, mask)
        assert video.dtype == torch.float32
        gradients = torch.autograd.grad(video.square().mean(), weights, allow_unused=True)
        return [video, torch.cat([gradient.flatten() for gradient in gradients if gradient is not None])]

    with kernels.plainly(decoder):
        reference = computed()
        with torch.autocast("cpu", torch.bfloat16):
            plain = computed()
    with torch.autocast("cpu", torch.bfloat16):
        fast = computed()
    for exact, one, other in zip(reference, plain, fast, strict=True):
        assert (other - exact).norm() <= 1.3 * (one - exact).norm() <= 0.1 * exact.norm()


def test_the_same_gradients() -> None:
    decoder, measurement, mask = STFormer(4, 16, 1), torch.rand(1, 16, 16), torch.rand(4, 16, 16)
    gradients = []
    for name in kernels.KERNELS:
        kernels.use(decoder, name)
        loss = decoder(measurement, mask).square().mean()
        gradients.append(torch.autograd.grad(loss, list(decoder.parameters())))
    for fast, plain in zip(*gradients, strict=True):
        torch.testing.assert_close(fast, plain, rtol=0, atol=1e-5 * float(plain.abs().max()))


def test_plain_takes_no_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    layer, x = Conv3d(32, 32, 3), torch.rand(1, 32, 4, 8, 8)
    reference = F.conv3d(x, layer.weight, layer.bias, padding=1)
    with kernels.plainly(layer):
        assert torch.equal(layer(x), reference)

    def refused(*_: Any) -> torch.Tensor:
        raise AssertionError("a kernel was called")

    monkeypatch.setattr("sci_lightning.decoder.layers.convolution.convolution3d", refused)
    with kernels.plainly(layer):
        layer(x)
    with pytest.raises(AssertionError, match="a kernel"):
        layer(x)


def test_a_choice_holds_for_one_decoder() -> None:
    one, other = STFormer(4, 16, 1), STFormer(4, 16, 1)
    kernels.use(one, "plain")
    with kernels.plainly(one), kernels.plainly(other):
        assert one.plain_formulas and other.plain_formulas
    assert one.plain_formulas and not other.plain_formulas
    with pytest.raises(BadInput, match="kernels=fast"):
        kernels.use(one, "fast")
    assert doctest.testmod(kernels).failed == 0
