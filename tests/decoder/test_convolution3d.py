"""Every way in which a convolution is computed is the convolution, and so are its gradients."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional as F

from sci_lightning.decoder.layers.convolution import Conv3d, TransposedConv3d
from sci_lightning.decoder.layers.kernels import as_one_channel
from sci_lightning.decoder.layers.winograd import winograd

CASES = {  # channels, outputs, kernel, stride; shape (N, T, H, W)
    "tiles": ((32, 48, 3, 1), (1, 8, 13, 17)),
    "tiles of single frames": ((40, 32, (1, 3, 3), 1), (2, 3, 8, 8)),
    "tiles, one frame": ((64, 32, 3, 1), (2, 1, 9, 4)),
    "tiles, more taps than frames": ((32, 32, (5, 3, 3), 1), (2, 2, 3, 3)),
    "several strips of tiles": ((32, 32, 3, 1), (2, 4, 30, 100)),
    "one output": ((16, 1, 3, 1), (2, 5, 9, 8)),
    "small": ((8, 8, 3, 1), (1, 4, 9, 9)),
    "small, several": ((8, 8, 3, 2), (2, 4, 9, 9)),
    "stride": ((40, 40, 3, 2), (1, 4, 11, 12)),
    "one channel": ((1, 8, 3, 1), (1, 6, 8, 7)),
    "large kernel": ((1, 8, (3, 7, 7), 1), (2, 6, 8, 7)),
    "more taps than frames": ((1, 24, 5, 1), (1, 3, 8, 7)),
    "points": ((8, 24, 1, 1), (2, 3, 4, 5)),
    "not small": ((48, 40, (3, 5, 5), 1), (1, 6, 80, 9)),
}


def close(result: torch.Tensor, reference: torch.Tensor) -> None:
    torch.testing.assert_close(result, reference.to(result), rtol=0, atol=4e-6 * float(reference.detach().abs().max()))


@pytest.mark.parametrize("case", CASES)
def test_equals_torch(case: str) -> None:
    (channels, *rest), (n, t, h, w) = CASES[case]
    layer = Conv3d(channels, *rest)
    x = as_one_channel(torch.randn(n, t, h, w)) if channels == 1 else torch.randn(n, channels, t, h, w)
    x.requires_grad_()
    exact = [each.detach().double().requires_grad_() for each in (x, layer.weight, layer.bias)]
    reference = F.conv3d(*exact, layer.stride, layer.padding)
    result = layer(x)
    close(result, reference)
    assert result.is_contiguous(memory_format=torch.channels_last_3d)
    assert torch.equal(result, layer(x.contiguous(memory_format=torch.channels_last_3d)))
    gradient = torch.randn_like(result)
    expected = torch.autograd.grad(reference, exact, gradient.double())
    for each, other in zip(torch.autograd.grad(result, [x, layer.weight, layer.bias], gradient), expected, strict=True):
        close(each, other)


def test_transposed_convolution_equals_torch() -> None:
    layer, x = TransposedConv3d(24, 8), torch.randn(2, 24, 3, 5, 6)
    close(layer(x), F.conv_transpose3d(x, layer.weight, layer.bias, (1, 2, 2), (0, 1, 1), (0, 1, 1)))
    assert layer(x).shape == (2, 8, 3, 10, 12)


def test_rounding_of_tiles() -> None:
    x, weight, bias = torch.randn(1, 64, 6, 20, 20), torch.randn(64, 64, 3, 3, 3), torch.randn(64)
    reference = F.conv3d(x.double(), weight.double(), bias.double(), padding=1)
    assert (winograd(x, weight, bias) - reference).norm() < 1e-6 * reference.norm()
