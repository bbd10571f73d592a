"""First weights scaled to unit variance: a decoder's result depends on its measurement from the first step on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig
from torch import nn

from sci_lightning.decoder import Decoder
from sci_lightning.decoder.layers.convolution import LastConv2d
from sci_lightning.training.initialisation import scale_to_unit_variance, start_at_unit_variance
from tests.training.small_training import Noise, system_and_trainer

DEEP = ("metasci", "revsci", "stformer", "birnat")
"""Networks at whose end nothing of the measurement is left, as torch draws their weights."""


def response(decoder: Decoder) -> float:
    """The mean change of the result when a tenth more light comes in."""
    torch.manual_seed(1)
    mask = (torch.rand(8, 32, 32) > 0.5).float()
    video = torch.rand(8, 32, 32).cumsum(-1) / 32
    measurement = (mask * video).sum(0, keepdim=True)
    with torch.no_grad():
        before, after = decoder(measurement, mask), decoder(1.1 * measurement, mask)
    return float((after - before).abs().mean())


def scaled(decoder: Decoder) -> Decoder:
    torch.manual_seed(2)
    mask = (torch.rand(8, 32, 32) > 0.5).float()
    scale_to_unit_variance(decoder, (mask * torch.rand(2, 8, 32, 32).cumsum(-1) / 32).sum(1), mask)
    return decoder


class Recurrence(Decoder):
    """A layer that is used again on its own result, which it doubles, then a last layer; frames are its channels."""

    def __init__(self, frames: int) -> None:
        super().__init__()
        self.step = nn.Conv2d(frames, frames, 3, padding=1)
        self.last = LastConv2d(frames, frames, 3, padding=1)
        nn.init.dirac_(self.step.weight)
        self.step.weight.data *= 2
        self.spreads: list[float] = []

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        x = measurement.unsqueeze(1) * mask
        self.spreads = []
        for _ in range(3):
            x = self.step(x)
            self.spreads.append(float(x.movedim(1, 0).flatten(1).var(1).mean().sqrt()))
        return self.last(x)


@pytest.mark.parametrize("name", [*DEEP, "e2e_cnn", "res2former", "sci3d", "elp_unfolding"])
def test_a_tenth_more_light_is_seen_in_the_result(configuration: Callable[..., DictConfig], name: str) -> None:
    torch.manual_seed(0)
    decoder = instantiate(configuration("train", f"decoder={name}", "scale=cpu").decoder, _convert_="all")
    if name in DEEP:
        assert response(decoder) < 1e-3
    assert 1e-3 < response(scaled(decoder)) < 1


def test_a_layer_that_is_used_again_ends_at_unit_variance() -> None:
    decoder = Recurrence(8)
    biases, last = decoder.step.bias.clone(), decoder.last.weight.clone()
    scaled(decoder)
    assert decoder.spreads[0] > 0.5 and all(spread <= 1.06 for spread in decoder.spreads)
    assert torch.equal(decoder.step.bias, biases) and torch.equal(decoder.last.weight, last)
    assert not decoder.step._forward_hooks


def test_every_process_begins_with_the_same_weights_and_the_same_noise(tmp_path: Path) -> None:
    begun = []
    for _ in range(2):
        torch.manual_seed(0)
        decoder = Recurrence(2)
        system, _, _ = system_and_trainer(tmp_path, decoder=decoder)
        before = torch.get_rng_state()
        start_at_unit_variance(system, Noise())
        assert torch.equal(torch.get_rng_state(), before)
        begun.append(decoder.step.weight.clone())
    assert torch.equal(*begun)
