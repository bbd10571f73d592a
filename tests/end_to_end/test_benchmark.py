"""The benchmark command: one decoder, all of them, and those that cannot be measured."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import DictConfig

from sci_lightning.cli.commands import benchmark
from sci_lightning.cli.composition import built, plain
from sci_lightning.errors import BadInput
from sci_lightning.runs import precision
from sci_lightning.runs.checkpoint import write_weights
from sci_lightning.studies.benchmark import decoder_cost
from tests.conftest import members
from tests.files.formats import check

Run = Callable[..., str]
COST = {
    "parameters": 817_608,
    "macs": 53_485_764_608,
    "macs_as_paper": 53_485_764_608,
    "precisions": {
        "32-true": {
            "seconds": 1.25,
            "fastest": 1.2,
            "calls": 3,
            "memory": 300 * 2**20,
            "gflops": 85.58,
            "psnr": 9.876,
        },
        "bf16-mixed": {"seconds": 0.5, "fastest": 0.4, "calls": 3, "gflops": 213.9, "psnr": 9.87},
    },
    "machine": {
        "32-true": {"product_gflops": 100.0, "convolution_gflops": 120.0},
        "bf16-mixed": {"product_gflops": 500.0, "convolution_gflops": 400.0},
    },
}


@pytest.mark.slow
def test_all(command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    asked = ["size=16", "repeats=1", "product=64", "training=1", "reduced=smoke", "out=run"]
    done = command("benchmark", "decoder=all", "only=[e2e_cnn]", *asked)
    assert done.returncode == 0, done.stderr
    assert "e2e_cnn" in done.stdout and "GFLOP/s" in done.stdout and "run: benchmark.json" in done.stdout
    result = json.loads((tmp_path / "run" / "benchmark.json").read_text())
    check("benchmark", result)
    assert result["format"] == "sci-benchmark" and result["size"] == [16, 16] and result["device"].startswith("cpu")
    assert result["provenance"]["command"].endswith("reduced=smoke out=run") and result["weights"] == "random weights"
    assert result["scene"].startswith("synthetic: ") and result["precisions"][0] == "32-true"
    cost = result["decoders"]["e2e_cnn"]
    assert cost["parameters"] < 100_000 and cost["paper"]["row"] == "E2E-CNN"  # the network of scale=smoke
    assert set(cost["precisions"]) == set(cost["training"]["precisions"]) == set(result["precisions"])
    assert (tmp_path / "run" / "benchmark.md").read_text().count("|") > 20


def test_decoders_that_fail_do_not_stop_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    measured = []

    def cost(config: dict[str, Any], **settings: Any) -> dict[str, Any]:
        measured.append(config["_target_"])
        assert settings["frames"] == 8 and settings["plain_kernels"] and config.get("frames", 8) == 8
        if "Res2former" in config["_target_"]:
            raise BadInput("did not fit")
        return COST

    monkeypatch.setattr(decoder_cost, "decoder_cost", cost)
    monkeypatch.setattr(precision, "multiplies_bfloat16", lambda device: True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        sys, "argv", ["benchmark", "decoder=all", "size=[256,256]", "device=cpu", "kernels=plain", "out=run"]
    )
    with pytest.raises(SystemExit) as caught:
        benchmark.main()
    out, err = capsys.readouterr()
    assert caught.value.code == 2 and len(measured) == len(members("decoder"))
    assert "res2former: did not fit; res2former_l: did not fit" in err
    assert err.startswith(f"error: 2 of {len(measured)}") and "53.49" in out
    result = json.loads((tmp_path / "run" / "benchmark.json").read_text())
    check("benchmark", result)
    assert set(result["decoders"]) | set(result["failed"]) == set(members("decoder"))
    table = (tmp_path / "run" / "benchmark.md").read_text()
    assert "| e2e_cnn | 0.82 (0.82) | 53.49 | 53.49 (53.49) |" in table
    assert "| e2e_cnn | float32 | 1.25 | 300 | 86 | 86% | 71% |  |" in table
    assert "| e2e_cnn | bfloat16 | 0.5 |  | 214 | 43% | 53% | 0.006 |" in table
    assert "| matrix product of side 2048 | 100 | 500 |" in table


@pytest.mark.slow
def test_trained_weights(checkpoint_of: Callable[..., Path], ran: Run, tmp_path: Path) -> None:
    checkpoint_of(tmp_path / "a.ckpt")
    ran("benchmark", "ckpt_path=a.ckpt", "precision=32", "repeats=1", "product=0", "out=run")
    result = json.loads((tmp_path / "run" / "benchmark.json").read_text())
    check("benchmark", result)
    assert (
        result["weights"] == "trained weights (a.ckpt)"
        and result["size"] == [32, 32]
        and list(result["decoders"]) == ["e2e_cnn"]
    )
    assert set(result["decoders"]["e2e_cnn"]["precisions"]) == {"32-true"}


@pytest.fixture
def checkpoint_of(configuration: Callable[..., DictConfig]) -> Callable[[Path], Path]:
    """Writes a checkpoint of a small network and a mask of 32 x 32 pixels."""

    def write(path: Path) -> Path:
        small = ["encoder=rbw_sr", "decoder=e2e_cnn", "size=[32,32]", "decoder.channels=4", "decoder.blocks=1"]
        cfg = configuration("train", *small)
        modules = torch.nn.ModuleDict({"encoder": built(cfg, "encoder"), "decoder": built(cfg, "decoder")})
        names = {"encoder": "rbw_sr", "decoder": "e2e_cnn"}
        write_weights(path, {**plain(cfg), "names": names}, modules.state_dict())
        return path

    return write


def test_bad_input(refused: Run) -> None:
    assert "decoder=res3former: no such decoder" in refused("benchmark", "decoder=res3former")
    assert "fp8" in refused("benchmark", "precision=fp8")
    assert re.search("reduced=tiny: .*cpu, gpu30", refused("benchmark", "reduced=tiny"))
    assert "no such file" in refused("benchmark", "ckpt_path=none.ckpt")
    assert "choose auto, cpu" in refused("benchmark", "device=tpu")
    assert "a whole number from 1" in refused("benchmark", "repeats=0")
