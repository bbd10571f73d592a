"""A corrected encoder in use: trained with, tested with, reconstructed with, in windows, sweeps and two processes."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.runs.checkpoint import read_checkpoint
from tests.encoder_files import encoder_file
from tests.training.small_training import TINY

Command = Callable[..., subprocess.CompletedProcess[str]]
SMALL = [*TINY, "trainer.max_epochs=1", "data.scenes_count=1", "callbacks.pictures=null", "logger=none"]


def test_train_evaluate_reconstruct(command: Command, tmp_path: Path) -> None:
    path = encoder_file(tmp_path / "camera")
    run = [f"encoder={path.relative_to(tmp_path)}", "encoder.sensor.bit_depth=10", "effect=[gain,optical_blur]"]
    done = command("train", *SMALL[:-2], *run, "crop=[16,16]", "out=run")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert result["encoder"] == result["test_encoder"] == "camera"
    assert result["config"]["encoder"]["sensor"]["bit_depth"] == 10
    assert set(result["config"]["encoder"]["effects"]) == {"mask_shift", "prnu", "shot_noise", "gain", "optical_blur"}

    checkpoint = read_checkpoint(tmp_path / "run" / "checkpoints" / "last.ckpt")
    maps = np.load(tmp_path / "camera" / "prnu.npy")
    for file in ("patterns.npy", "prnu.npy"):  # the checkpoint holds what was measured
        (tmp_path / "camera" / file).rename(tmp_path / file)
    encoder = checkpoint.encoder()
    prnu = encoder.path.effects["prnu"]
    np.testing.assert_allclose(prnu.map.numpy(), maps, atol=1e-6)
    scenes = ["ckpt_path=run/checkpoints/last.ckpt", "data=synthetic", "data.scenes_count=1"]
    done = command("evaluate", *scenes, "out=again")
    assert done.returncode == 0, done.stderr
    again = json.loads((tmp_path / "again" / "metrics.json").read_text())
    assert again["mean"] == pytest.approx(result["mean"], abs=1e-6)

    for file in ("patterns.npy", "prnu.npy"):
        (tmp_path / file).rename(tmp_path / "camera" / file)
    done = command("evaluate", *scenes, f"encoder={path}", "out=other")
    assert done.returncode == 0, done.stderr
    other = json.loads((tmp_path / "other" / "metrics.json").read_text())
    assert (other["encoder"], other["test_encoder"]) == ("camera", "camera") and other["mean"] != result["mean"]

    snapshot = torch.randint(0, 1024, (2, 32, 32)).numpy().astype(np.uint16)
    np.save(tmp_path / "snapshot.npy", snapshot)
    done = command("reconstruct", scenes[0], "measurement=snapshot.npy", "precision=32", "out=video")
    assert done.returncode == 0, done.stderr
    with torch.no_grad():
        linear = encoder.normalised(torch.from_numpy(snapshot / np.float32(1023)))
        expected = checkpoint.decoder()(linear, encoder.decoder_mask())
    video = np.load(tmp_path / "video" / "reconstruction.npy")
    np.testing.assert_allclose(video, expected.numpy(), atol=1e-5)
    done = command("reconstruct", scenes[0], f"encoder={path}", "measurement=snapshot.npy", "out=corrected")
    assert done.returncode == 0, done.stderr
    assert np.abs(np.load(tmp_path / "corrected" / "reconstruction.npy") - video).max() > 1e-4


@pytest.mark.slow
def test_learned_mask_with_effects_then_without(command: Command, tmp_path: Path) -> None:
    done = command("train", *SMALL, "effect=[mask_blur,prnu,read_noise]", "encoder.effects.prnu.std=0.05", "out=run")
    assert done.returncode == 0, done.stderr
    scenes = ["ckpt_path=run/checkpoints/last.ckpt", "data=synthetic", "data.scenes_count=1"]
    for name, encoder in (
        ("same", []),
        ("ideal", ["encoder=lsw_sr"]),
        ("moved", ["encoder=lsw_sr", "effect=mask_shift"]),
    ):
        done = command("evaluate", *scenes, *encoder, f"out={name}")
        assert done.returncode == 0, done.stderr
    trained, same, ideal, moved = (
        json.loads((tmp_path / name / "metrics.json").read_text())["mean"]["psnr"]
        for name in ("run", "same", "ideal", "moved")
    )
    assert same == pytest.approx(trained, abs=1e-6)
    assert len({round(value, 5) for value in (same, ideal, moved)}) == 3
    done = command("evaluate", *scenes, "effect=mask_shift")
    assert done.returncode == 2 and "encoder=lsw_sr" in done.stderr


def test_sweep_and_listing(command: Command, tmp_path: Path) -> None:
    path = encoder_file(tmp_path / "camera")
    done = command("train", f"encoder={path}", "--cfg", "job", "--package", "encoder.effects")
    assert done.returncode == 0 and "dx: 0.61" in done.stdout, done.stderr
    done = command("train", "-m", *SMALL, f"encoder={path},rsw_sr", "out=sweep")
    assert done.returncode == 0, done.stderr
    used = [json.loads((tmp_path / "sweep" / job / "metrics.json").read_text())["encoder"] for job in "01"]
    assert used == ["camera", "rsw_sr"]


@pytest.mark.slow
def test_two_processes(command: Command, tmp_path: Path) -> None:
    path = encoder_file(tmp_path / "camera")
    two = ["trainer.devices=2", "trainer.strategy=ddp"]
    done = command("train", *SMALL, *two, f"encoder={path.relative_to(tmp_path)}", "out=run")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["encoder"] == "camera"
