"""The benchmark command: one decoder, all of them, and those that cannot be measured."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.benchmark import __main__ as benchmark
from sci_lightning.benchmark import decoder_cost
from sci_lightning.decoder import kernels
from sci_lightning.errors import BadInput
from tests.conftest import members
from tests.schemas.validation import check

Run = Callable[..., str]
COST = {
    "parameters": 817_608,
    "macs": 53_485_764_608,
    "macs_as_paper": 53_485_764_608,
    "seconds": 1.25,
    "gflops": 85.58,
}


def test_all(command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    done = command("benchmark", "decoder=all", "only=[e2e_cnn]", "size=16", "repeats=1", "product=64", "out=run")
    assert done.returncode == 0, done.stderr
    assert "e2e_cnn" in done.stdout and "0.82" in done.stdout and "run: benchmark.json" in done.stdout
    found = json.loads((tmp_path / "run" / "benchmark.json").read_text())
    check("benchmark", found)
    assert found["format"] == "sci-benchmark" and found["size"] == [16, 16] and found["device"].startswith("cpu")
    assert found["decoders"]["e2e_cnn"]["macs"] == 53_485_764_608 // 256
    assert found["decoders"]["e2e_cnn"]["paper"]["row"] == "E2E-CNN"
    assert (tmp_path / "run" / "benchmark.md").read_text().count("|") > 20


def test_decoders_that_fail_do_not_stop_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    measured = []

    def cost(config: dict[str, Any], **settings: Any) -> dict[str, Any]:
        measured.append(config["_target_"])
        assert settings["frames"] == 8 and kernels.are_plain() and config.get("frames", 8) == 8
        if "Res2former" in config["_target_"]:
            raise BadInput("did not fit")
        return {**COST, "memory": 300 * 2**20}

    monkeypatch.setattr(decoder_cost, "decoder_cost", cost)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        sys, "argv", ["benchmark", "decoder=all", "size=[256,256]", "device=cpu", "kernels=plain", "out=run"]
    )
    with pytest.raises(SystemExit) as caught, kernels.use("auto"):
        benchmark.main()
    out, err = capsys.readouterr()
    assert caught.value.code == 2 and len(measured) == len(members("decoder"))
    assert "decoders could not be measured: res2former: did not fit; res2former_l: did not fit" in err
    assert err.startswith(f"error: 2 of {len(measured)}") and "53.49" in out
    found = json.loads((tmp_path / "run" / "benchmark.json").read_text())
    assert set(found["decoders"]) | set(found["failed"]) == set(members("decoder"))
    table = (tmp_path / "run" / "benchmark.md").read_text()
    assert "| e2e_cnn | 0.82 (0.82) | 53.49 | 53.49 (53.49) | 1.25 (0.01) | 300 | 86 |  |" in table
    assert "in brackets the paper's Table 4" in table


def test_bad_input(refused: Run) -> None:
    assert "decoder=res3former: no such decoder" in refused("benchmark", "decoder=res3former")
    assert "32-true, bf16-mixed" in refused("benchmark", "precision=fp8")
    assert "choose auto, cpu" in refused("benchmark", "device=tpu")
    assert "a whole number from 1" in refused("benchmark", "repeats=0")
