"""Steps that are replayed: the same training as without, and what cannot be replayed."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from sci_lightning.decoder import E2ECNN
from sci_lightning.training.cuda_graph import GraphedStages
from tests.training.small_training import train

gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


@pytest.mark.filterwarnings("ignore")
def test_a_training_without_a_gpu_is_the_same(tmp_path: Path) -> None:
    usual, graphed = (train(tmp_path / name, cuda_graph=name == "graphed") for name in ("usual", "graphed"))
    assert usual is not None and graphed is not None and usual["state_dict"].keys() == graphed["state_dict"].keys()
    assert all(torch.equal(usual["state_dict"][key], value) for key, value in graphed["state_dict"].items())


@gpu
@pytest.mark.parametrize("learned", [True, False])
def test_a_replay_computes_what_a_call_does(learned: bool) -> None:
    torch.manual_seed(0)
    decoder = E2ECNN(4, 16, 1).cuda()
    graphed = GraphedStages(decoder)
    for number in range(3):
        if number:  # a replay looks at the weights as they are then
            with torch.no_grad():
                for weight in decoder.parameters():
                    weight.mul_(1.1)
        results = []
        measurement, mask = torch.rand(2, 16, 16, device="cuda"), torch.rand(4, 16, 16, device="cuda")
        for stages in (graphed, decoder.stages):
            decoder.zero_grad()
            shown = mask.clone().requires_grad_(learned)
            (estimate,) = stages(measurement, shown)
            estimate.square().mean().backward()
            weights = list(decoder.parameters())
            gradients = [weight.grad.clone() for weight in weights if weight.grad is not None]
            assert len(gradients) == len(weights)
            results.append([estimate.detach().clone(), *gradients, *([shown.grad] if learned else [])])
        for one, other in zip(*results, strict=True):
            torch.testing.assert_close(one, other)
    smaller = graphed(torch.rand(2, 8, 8, device="cuda"), torch.rand(4, 8, 8, device="cuda"))
    assert smaller[0].shape == (2, 4, 8, 8)


def test_gradients_of_several_batches(command: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    done = command("train", "system.cuda_graph=true", "trainer.accumulate_grad_batches=2", "scale=smoke")
    assert done.returncode == 2 and "overwrites the gradients" in done.stderr
