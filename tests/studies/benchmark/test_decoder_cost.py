"""Time and memory of one measurement, in a process of its own; both precisions, published code and training steps."""

from __future__ import annotations

import os
from typing import Any, ClassVar

import pytest
import torch

from sci_lightning.decoder import Decoder
from sci_lightning.errors import BadInput
from sci_lightning.studies.benchmark.decoder_cost import decoder_cost, measure
from sci_lightning.studies.benchmark.timing import seconds_in_turns, times_as_fast

SETTINGS: dict[str, Any] = {
    "frames": 4,
    "size": (16, 24),
    "rules": 2022,
    "device": "cpu",
    "precisions": ["32-true"],
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


@pytest.mark.slow
def test_memory_is_the_decoders_own() -> None:
    ballast = torch.ones(200 * MIB // 4)  # of this process, which must not count
    result = decoder_cost({"_target_": f"{__name__}.Hungry"}, **SETTINGS)
    assert 72 * MIB <= result["precisions"]["32-true"]["memory"] < 72 * MIB + 40 * MIB
    assert len(ballast) and result["parameters"] == 2 * MIB and result["macs"] == result["macs_as_paper"] == 0


@pytest.mark.slow
def test_figures_fit_together() -> None:
    config = {"_target_": "sci_lightning.decoder.E2ECNN", "frames": 4, "channels": 8, "blocks": 5}
    settings = {**SETTINGS, "precisions": ["32-true", "bf16-mixed"], "training": 2}
    result = measure(config, **settings)
    macs = 16 * 24 * 8 * (9 * 4 + 22 * 9 * 8 + 4)
    assert result["macs"] == result["macs_as_paper"] == macs
    for precision in settings["precisions"]:
        cost, speed = result["precisions"][precision], result["machine"][precision]
        assert 0 < cost["fastest"] <= cost["seconds"] < 10 and cost["calls"] == 3
        assert cost["gflops"] == pytest.approx(2e-9 * macs / cost["seconds"])
        assert set(speed) == {"product_gflops", "convolution_gflops", "convolution_training_gflops"}
        assert min(speed.values()) > 0
        step = result["training"]["precisions"][precision]
        assert step["gflops"] == pytest.approx(3 * 2 * 2e-9 * macs / step["seconds"])
    difference = result["precisions"]["32-true"]["psnr"] - result["precisions"]["bf16-mixed"]["psnr"]
    assert 0 < abs(difference) < 0.1  # another arithmetic, and nearly the same video
    assert result["training"]["snapshots"] == 2 and result["training"]["times_as_fast"] > 0


def test_less_is_measured_where_less_is_asked_for() -> None:
    config = {"_target_": "sci_lightning.decoder.E2ECNN", "frames": 4, "channels": 8, "blocks": 1}
    result = measure(config, **{**SETTINGS, "rules": 2020, "product": 0, "budget": 1e-9})
    macs = 16 * 24 * 8 * (9 * 4 + 6 * 9 * 8 + 4)
    assert result["macs_as_paper"] == macs + 16 * 24 * (8 * 7 + 4 + 8 * 4)
    assert result["precisions"]["32-true"]["calls"] == 1 and not {"machine", "training"} & set(result)


def test_trained_weights_and_a_snapshot() -> None:
    from sci_lightning.decoder import E2ECNN

    config = {"_target_": "sci_lightning.decoder.E2ECNN", "frames": 2, "channels": 4, "blocks": 1}
    decoder, mask, video = E2ECNN(2, 4, 1).eval(), torch.ones(2, 16, 16), torch.rand(1, 2, 16, 16)
    snapshot = (mask * video).sum(1), mask, video
    with torch.no_grad():
        error = (decoder(*snapshot[:2]) - video).square().mean((-2, -1))
    settings = {**SETTINGS, "frames": 2, "size": (16, 16), "snapshot": snapshot, "state": decoder.state_dict()}
    result = measure(config, **settings)
    assert result["precisions"]["32-true"]["psnr"] == pytest.approx(float((-10 * error.log10()).mean()), abs=1e-3)


def test_calls_take_turns() -> None:
    order: list[str] = []
    calls = {name: (lambda name=name: order.append(name)) for name in "ab"}
    seconds = seconds_in_turns(calls, torch.device("cpu"), 1, 2)
    assert order == [*"ab", *"ab", *"ab"] and [len(times) for times in seconds.values()] == [2, 2]
    assert times_as_fast([1.0, 2.0, 1.0], [2.0, 6.0, 1.0]) == 2.0


@pytest.mark.parametrize("name", [pytest.param("Killed", marks=pytest.mark.slow), "TooLarge"])
def test_want_of_memory(name: str) -> None:
    with pytest.raises(BadInput, match=r"memory; .*size="):
        decoder_cost({"_target_": f"{__name__}.{name}"}, **SETTINGS)


def test_what_the_decoder_finds_wrong() -> None:
    with pytest.raises(BadInput, match="built for 5 frames, the mask has 4"):
        measure({"_target_": "sci_lightning.decoder.E2ECNN", "frames": 5, "channels": 4}, **SETTINGS)


class Watched(Decoder):
    """Copies the measurement, and keeps the shapes that it is called with."""

    shapes: ClassVar[list[tuple[int, ...]]] = []
    receptive_field = 1

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        if not measurement.is_meta:
            self.shapes.append(tuple(measurement.shape))
        return measurement[:, None].expand(-1, len(mask), -1, -1)


def test_a_large_field_is_measured_in_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("sci_lightning.studies.benchmark.decoder_cost._report", said.append)
    settings = {**SETTINGS, "product": 0, "size": (64, 96), "repeats": 1}
    measure({"_target_": f"{__name__}.Watched"}, **settings, tile=(32, 48))
    assert max(shape[1] * shape[2] for shape in Watched.shapes) <= 34 * 50 and "tile 4 of 4" in said


def test_what_is_being_computed_is_said() -> None:
    said: list[str] = []
    decoder_cost({"_target_": f"{__name__}.Watched"}, on_progress=said.append, **{**SETTINGS, "product": 0})
    assert "32-true" in said and "counting operations" in said
