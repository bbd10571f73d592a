"""FFDNet and FastDVDnet: what they look at, and what they cost."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.decoder.complexity import count_macs, count_parameters
from sci_lightning.decoder.denoiser import Denoiser, FastDVDnet, FFDNet


def small() -> list[Denoiser]:
    return [FFDNet(8, 4), FastDVDnet((4, 6, 8), 3)]


@pytest.mark.parametrize("denoiser", small())
def test_any_size(denoiser: Denoiser) -> None:
    video = torch.rand(2, 5, 13, 18)
    result = denoiser(video, 0.1)
    assert result.shape == video.shape and not torch.equal(result, video)
    torch.testing.assert_close(denoiser(video[1:], 0.1), result[1:])
    assert not torch.equal(denoiser(video, 0.2), result)  # the strength is told
    denoiser.train()
    assert torch.equal(denoiser(video, 0.1), result)  # statistics are those of the weights


def test_which_frames_count() -> None:
    video = torch.rand(1, 7, 8, 8)
    changed = video.clone()
    changed[:, 0] += 1
    for denoiser, reach in zip(small(), ([0], [5, 6, 0, 1, 2]), strict=True):  # circular: two frames to either side
        difference = (denoiser(changed, 0.1) - denoiser(video, 0.1)).abs().amax((0, 2, 3))
        assert [t for t in range(7) if difference[t] > 0] == sorted(reach)


@pytest.mark.parametrize(
    ("name", "facts", "share"), [("ffdnet", "ffdnet_gray", 1), ("fastdvdnet", "fastdvdnet_gray", 0.5)]
)
def test_cost(name: str, facts: str, share: float, configuration: Callable[..., DictConfig], reference: Path) -> None:
    """The published FastDVDnet runs the first pass three times for each frame; it is the same one frame later."""
    facts_of_network = json.loads((reference / f"{facts}.json").read_text())
    one = ["decoder.start=null", "decoder.motion=null", "decoder.iterations=[1]"]
    with torch.device("meta"):
        decoder = instantiate(configuration("train", f"decoder=pnp_{name}", *one).decoder, _convert_="all")
    assert count_parameters(decoder) == facts_of_network["parameters"]["total"]
    assert count_macs(decoder, 8, 256, 256) == share * facts_of_network["macs"]["exact_conv_linear_matmul"]
