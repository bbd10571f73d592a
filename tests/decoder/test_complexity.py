"""Counting as the paper does: rule by rule, and its own figures to the printed digit."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
import torch
from hydra.utils import instantiate
from torch import nn
from torch.nn import functional as F

from sci_lightning.cli.composition import compose
from sci_lightning.decoder import Decoder
from sci_lightning.decoder.complexity import count_as_paper, count_macs, count_parameters
from sci_lightning.errors import BadInput
from sci_lightning.studies.tables.paper_figures import paper_figures
from tests.conftest import members
from tests.decoder.published_facts import FILES, PUBLISHED

PAPER = paper_figures()["decoders"]


class Layer(Decoder):
    """The mask (T, H, W), as T channels of one image, through a layer."""

    def __init__(self, layer: Callable[[torch.Tensor], torch.Tensor]) -> None:
        super().__init__()
        self.layer = layer

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        self.layer(mask.unsqueeze(0))
        return mask.unsqueeze(0)


class Affine(nn.Module):
    """A function with a weight of its own, which is no layer of torch's."""

    def __init__(self, function: Callable[..., torch.Tensor], *shape: int) -> None:
        super().__init__()
        self.function = function
        self.weight = nn.Parameter(torch.zeros(shape))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.function(x, self.weight)


PIXELS = 6 * 10
RULES = {  # T = 4 on 6 x 10 pixels: layer, count of 2022, count of 2020
    "convolution": (nn.Conv2d(4, 8, 3, padding=1), PIXELS * 8 * 36, PIXELS * 8 * 37),
    "no bias": (nn.Conv2d(4, 8, 3, padding=1, bias=False), PIXELS * 8 * 36, PIXELS * 8 * 36),
    "groups, stride": (nn.Conv2d(4, 8, 3, 2, 1, groups=2), 15 * 8 * 18, 15 * 8 * 19),
    "functional": (Affine(F.conv2d, 8, 4, 1, 1), PIXELS * 8 * 4, PIXELS * 8 * 4),
    "transposed": (nn.ConvTranspose2d(4, 8, 2, 2, bias=False), 4 * PIXELS * 8 * 16, 4 * PIXELS * 8 * 16),
    "linear, bias": (nn.Linear(10, 3), 24 * 3 * 10, 24 * 3 * 10),
    "layer norm": (nn.LayerNorm(10), 4 * 240, 2 * 240),
    "leaky relu": (nn.LeakyReLU(), 0, 240),
    "in place": (lambda x: F.leaky_relu_(x.clone()), 0, 240),
    "relu": (nn.ReLU(), 0, 0),
    "softmax": (nn.Softmax(-1), 24 * 29, 24 * 29),
    "attention": (lambda x: F.scaled_dot_product_attention(x, x, x), 24 * 17, 24 * 17),
    "called as functions": (lambda x: (x @ x.transpose(-1, -2)).softmax(dim=-1) @ x, 0, 0),
}


@pytest.mark.parametrize("name", RULES)
def test_rule(name: str) -> None:
    layer, of_2022, of_2020 = RULES[name]
    assert count_as_paper(Layer(layer), 4, 6, 10) == of_2022
    assert count_as_paper(Layer(layer), 4, 6, 10, rules=2020) == of_2020


def test_other_rules() -> None:
    with pytest.raises(BadInput, match="2022 or 2020"):
        count_as_paper(Layer(nn.ReLU()), 4, 6, 10, rules=2021)


class Stacked(nn.Conv3d):
    """A convolution of a video as one of its frames, beside which their neighbours are laid; the bias comes after."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        frames = F.pad(x, (0, 0, 0, 0, 1, 1)).unfold(2, 3, 1)[0].permute(1, 4, 0, 2, 3).flatten(1, 2)
        weight = self.weight.transpose(1, 2).flatten(1, 2)
        assert self.bias is not None
        return F.conv2d(frames, weight, padding=1).transpose(0, 1).unsqueeze(0) + self.bias[:, None, None, None]


@pytest.mark.parametrize("rules", [2022, 2020])
def test_a_layer_counts_by_what_it_is(rules: int) -> None:
    counts = set()
    for kind in (nn.Conv3d, Stacked):
        layers = nn.Sequential(nn.Unflatten(1, (2, 4)), kind(2, 5, 3, padding=1), nn.LeakyReLU())
        counts.add(count_as_paper(Layer(layers), 8, 6, 10, rules))
        x = torch.rand(1, 2, 4, 6, 10)
        assert torch.allclose(layers[1](x), nn.Conv3d.forward(layers[1], x), atol=1e-5)
    assert counts == {4 * PIXELS * 5 * (54 if rules == 2022 else 54 + 1 + 1)}


@pytest.fixture(scope="module")
def full_size() -> Callable[[str], Decoder]:
    """A decoder of the published size, without memory for its weights."""

    @cache
    def built(name: str) -> Decoder:
        with torch.device("meta"):
            return instantiate(compose("train", [f"decoder={name}"]).cfg.decoder, _convert_="all")

    return built


@pytest.fixture(scope="module")
def exact_macs(full_size: Callable[[str], Decoder]) -> Callable[[str], int]:
    """Its multiply-accumulates at 256 x 256 x 8, which take seconds to count."""
    return cache(lambda name: count_macs(full_size(name), 8, 256, 256))


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_size(name: str, full_size: Callable[[str], Decoder], exact_macs: Callable[[str], int]) -> None:
    assert (count_parameters(full_size(name)), exact_macs(name)) == PUBLISHED[name]


@pytest.mark.parametrize("name", PAPER)
def test_the_papers_figures(name: str, full_size: Callable[[str], Decoder]) -> None:
    if name not in members("decoder"):
        pytest.skip("no such decoder yet")
    decoder, figures = full_size(name), PAPER[name]
    count = count_as_paper(decoder, 8, 256, 256, figures["macs_rules"])
    assert f"{count / 1e9:.2f}" == f"{figures['macs_G']:.2f}"
    tables = sum(value.numel() for key, value in decoder.named_parameters() if "position" in key)
    assert f"{(count_parameters(decoder) - tables) / 1e6:.2f}" == f"{figures['parameters_M']:.2f}"


@pytest.mark.parametrize("name", members("decoder"))
def test_reference(
    name: str, full_size: Callable[[str], Decoder], exact_macs: Callable[[str], int], reference: Path
) -> None:
    path = reference / f"{FILES.get(name, name)}.json"
    if not path.is_file():
        pytest.skip(f"no facts about {name}")
    facts, decoder = json.loads(path.read_text()), full_size(name)
    assert count_parameters(decoder) == facts["parameters"]["total"]
    assert exact_macs(name) == pytest.approx(facts["macs"]["exact_conv_linear_matmul"], rel=1e-3)
    assert count_as_paper(decoder, 8, 256, 256) == facts["macs"]["thop_0_1_1"]
    assert count_as_paper(decoder, 8, 256, 256, 2020) == facts["macs"]["thop_2020_rules"]
