"""The protocol: what is lost, what is won back, and what is computed only once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sci_lightning.decoder import Linear
from sci_lightning.studies.mismatch import beliefs
from sci_lightning.studies.mismatch.beliefs import diagnosed_camera
from sci_lightning.studies.mismatch.bench import Bench
from sci_lightning.studies.mismatch.cameras import MismatchedCamera
from sci_lightning.studies.mismatch.protocol import Protocol, common_factor
from sci_lightning.studies.mismatch.scenarios import recovery
from tests.studies.mismatch.conftest import PUBLISHED, made_bench

WITHOUT = ["ideal", "ideal_noisy", "mismatched", "known"]
BRIGHT = MismatchedCamera("alone_gain", {"gain": {"factor": 1.4}})


def psnr(results: dict[str, Any]) -> dict[str, float]:
    return {key: scores["mean"]["psnr"] for key, scores in results["scenarios"].items()}


def test_what_is_lost_and_what_the_truth_wins_back(bench: Bench, tmp_path: Path) -> None:
    lines: list[str] = []
    protocol = Protocol(bench, tmp_path, 8, on_progress=lines.append)
    results = protocol.run(MismatchedCamera("published", PUBLISHED), Linear(), "linear", WITHOUT)
    figures = psnr(results)
    assert list(figures) == WITHOUT and set(results["scenarios"]["known"]["scenes"]) == {"one", "two"}
    assert figures["ideal"] > figures["ideal_noisy"] > figures["known"] > figures["mismatched"] + 2
    assert any(line.startswith("published, linear, III: two") for line in lines)
    assert "recovery" not in results and "diagnosis" not in results


def test_what_was_computed_before_is_kept(bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    protocol, recorded = Protocol(bench, tmp_path, 8), []
    record = Bench.record
    monkeypatch.setattr(
        Bench, "record", lambda self, mismatch, **rest: recorded.append(mismatch) or record(self, mismatch, **rest)
    )
    first = protocol.run(BRIGHT, Linear(), "linear", ["ideal", "mismatched"])
    assert recorded == [{}, BRIGHT.mismatch]
    whole = protocol.run(BRIGHT, Linear(), "linear", WITHOUT, first)
    assert recorded == [{}, BRIGHT.mismatch, {}, BRIGHT.mismatch]  # for ideal_noisy and for known
    assert list(whole["scenarios"]) == WITHOUT and whole["seconds"] > first["seconds"]
    assert whole["scenarios"]["mismatched"] is first["scenarios"]["mismatched"]
    protocol.run(MismatchedCamera("alone_blur", {"mask_blur": {"sigma": 1.0}}), Linear(), "linear", ["ideal", "known"])
    assert len(recorded) == 5  # the ideal camera's scores are those of any camera


def test_a_gain_that_nobody_knows_does_not_count_up_to_gain(bench: Bench, tmp_path: Path) -> None:
    protocol = Protocol(bench, tmp_path, 8)
    results = protocol.run(BRIGHT, Linear(), "linear", ["mismatched", "known"])
    unaware, aware = (results["scenarios"][key]["mean"] for key in ("mismatched", "known"))
    assert unaware["psnr"] < aware["psnr"] - 3
    assert unaware["psnr_up_to_gain"] == pytest.approx(aware["psnr_up_to_gain"], abs=0.3)
    assert aware["psnr_up_to_gain"] >= aware["psnr"] - 0.05
    blurred = protocol.run(
        MismatchedCamera("alone_blur", {"mask_blur": {"sigma": 1.5}}), Linear(), "linear", ["mismatched", "known"]
    )
    unaware, aware = (blurred["scenarios"][key]["mean"]["psnr_up_to_gain"] for key in ("mismatched", "known"))
    assert unaware < aware - 1


def test_the_factor_that_all_estimates_share() -> None:
    truth = torch.rand(2, 3, 4, 4, generator=torch.Generator().manual_seed(0))
    assert common_factor([(2 * truth[0], truth[0]), (2 * truth[1], truth[1])]) == pytest.approx(0.5)
    between = common_factor([(2 * truth[0], truth[0]), (truth[1], truth[1])])
    assert 0.5 < between < 1
    assert common_factor([(torch.zeros(1, 2, 2), torch.ones(1, 2, 2))]) == 1.0


def test_a_diagnosis_wins_the_loss_back_and_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = made_bench(tmp_path)
    protocol = Protocol(bench, tmp_path, 8)
    results = protocol.run(BRIGHT, Linear(), "linear", ["mismatched", "known", "calibrated"])
    assert results["recovery"]["calibrated"] == pytest.approx(1, abs=0.02)
    diagnosis = results["diagnosis"]["calibrated"]
    assert [effect["name"] for effect in diagnosis["effects"]] == ["gain"] and diagnosis["captures"] == 14
    assert diagnosis["effects"][0]["parameters"]["factor"]["value"] == pytest.approx(1.4, abs=0.01)
    folder = tmp_path / "cameras" / "alone_gain" / "calibrated"
    assert {path.name for path in folder.iterdir()} >= {"encoder.yaml", "report.json", "diagnosis.json"}

    made: list[int] = []
    monkeypatch.setattr(beliefs, "_diagnose", lambda *_: made.append(1))
    arguments: Any = (bench, BRIGHT, "calibrated", np.zeros(0), 8, tmp_path / "cameras", print)
    encoder, kept = diagnosed_camera(*arguments)
    assert not made and kept == diagnosis and encoder.path.names[:1] == ["gain"]
    with pytest.raises(TypeError):  # of other calibration captures: made anew
        diagnosed_camera(made_bench(tmp_path, seed=1), *arguments[1:])
    assert made and not (folder / "diagnosis.json").exists()


@pytest.mark.slow
def test_a_blind_diagnosis_sees_the_snapshots_alone(tmp_path: Path) -> None:
    camera = MismatchedCamera("alone_mask_shift", {"mask_shift": {"dx": 1.5, "dy": 1.0}})
    protocol = Protocol(made_bench(tmp_path), tmp_path, 8)
    results = protocol.run(camera, Linear(), "linear", ["mismatched", "known", "blind"])
    assert results["recovery"]["blind"] > 0.8 and results["diagnosis"]["blind"]["captures"] == 3
    assert "mask_shift" in [effect["name"] for effect in results["diagnosis"]["blind"]["effects"]]


def test_recovery() -> None:
    figures = {"mismatched": 20.0, "known": 30.0, "calibrated": 29.0}
    assert recovery(figures) == {"calibrated": 0.9}
    assert recovery({**figures, "blind": 25.0}) == {"calibrated": 0.9, "blind": 0.5}
    assert recovery({**figures, "known": 20.01}) == {} and recovery({"known": 30.0, "calibrated": 29.0}) == {}
