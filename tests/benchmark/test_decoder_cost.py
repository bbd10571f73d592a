"""Time and memory of one measurement, in a process of its own."""

from __future__ import annotations

import os
from typing import Any

import pytest
import torch

from sci_lightning.benchmark.decoder_cost import decoder_cost
from sci_lightning.decoder import Decoder
from sci_lightning.errors import BadInput

SETTINGS: dict[str, Any] = {
    "frames": 4,
    "size": (16, 24),
    "rules": 2022,
    "device": "cpu",
    "precision": "32-true",
    "compile": False,
    "warm_up": 1,
    "repeats": 3,
    "budget": 60,
    "product": 64,
}
MIB = 2**20


class Hungry(Decoder):
    """8 MiB of weights; 64 MiB more for a moment in every call."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(torch.ones(8 * MIB // 4))

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        if not measurement.is_meta:
            torch.ones(64 * MIB // 4)
        return mask.expand(len(measurement), -1, -1, -1)


class Killed(Decoder):
    """Ends the process, as the system does when memory runs out."""

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        os._exit(9)


class TooLarge(Decoder):
    """Asks for more memory than there is."""

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return torch.empty(2**50)


def test_memory_is_the_decoders_own() -> None:
    ballast = torch.ones(200 * MIB // 4)  # of this process, which must not count
    found = decoder_cost({"_target_": f"{__name__}.Hungry"}, **SETTINGS)
    assert 72 * MIB <= found["memory"] < 72 * MIB + 40 * MIB
    assert len(ballast) and found["parameters"] == 2 * MIB and found["macs"] == found["macs_as_paper"] == 0


def test_figures_fit_together() -> None:
    config = {"_target_": "sci_lightning.decoder.E2ECNN", "frames": 4, "channels": 8, "blocks": 1}
    found = decoder_cost(config, **SETTINGS)
    macs = 16 * 24 * 8 * (9 * 4 + 6 * 9 * 8 + 4)
    assert found["macs"] == found["macs_as_paper"] == macs
    assert 0 < found["fastest"] <= found["seconds"] < 10 and found["calls"] == 3
    assert found["gflops"] == pytest.approx(2e-9 * macs / found["seconds"]) and found["product_gflops"] > 0
    rules = {**SETTINGS, "rules": 2020, "product": 0, "precision": "bf16-mixed", "budget": 1e-9}
    found = decoder_cost(config, **rules)
    assert found["macs_as_paper"] == macs + 16 * 24 * (8 * 7 + 4 + 8 * 4) and "product_gflops" not in found
    assert found["calls"] == 1


@pytest.mark.parametrize("name", ["Killed", "TooLarge"])
def test_want_of_memory(name: str) -> None:
    with pytest.raises(BadInput, match="did not fit into memory; give a smaller size="):
        decoder_cost({"_target_": f"{__name__}.{name}"}, **SETTINGS)


def test_what_the_decoder_finds_wrong() -> None:
    with pytest.raises(BadInput, match="built for 5 frames, the mask has 4"):
        decoder_cost({"_target_": "sci_lightning.decoder.E2ECNN", "frames": 5, "channels": 4}, **SETTINGS)
