"""Training as a user runs it, at a small size: what it writes, that it learns, that others take it up."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sci_lightning.runs.checkpoint import read_checkpoint
from tests.clips import clips
from tests.files.formats import check
from tests.training.small_training import TINY
from tests.warm_process import WarmProcesses

Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, warm_processes: WarmProcesses) -> Path:
    """One tiny training run that the tests of this file look at."""
    out = tmp_path_factory.mktemp("run")
    done = warm_processes.run("sci_lightning.train", [*TINY, "data.scenes_count=2", f"out={out}"], out, os.environ)
    assert done.returncode == 0, done.stderr
    assert str(out) in done.stdout and "mean measurement" in done.stdout
    assert "checkpoints/last.ckpt, pictures/, tensorboard/\n" in done.stdout
    lines = re.findall(r"^epoch (\d), step (\d): train/loss \S+, val/psnr \S+$", done.stdout, re.MULTILINE)
    assert lines == [("0", "4"), ("1", "8")], "a file shows no bar, but a line after each validation"
    return out


@pytest.mark.slow
def test_what_a_file_shows_of_a_training_without_a_logger(command: Command, tmp_path: Path) -> None:
    done = command("train", *TINY, "out=run", "logger=none", "callbacks.progress.line_seconds=0", "metrics.qscore=null")
    assert done.returncode == 0, done.stderr
    assert set(re.findall(r"^epoch \d, step (\d)", done.stdout, re.MULTILINE)) == set("12345678")
    assert "checkpoints/last.ckpt, pictures/\n" in done.stdout


def test_metrics_file(run: Path) -> None:
    result = json.loads((run / "metrics.json").read_text())
    check("metrics", result)
    assert (result["format"], result["format_version"]) == ("sci-metrics", 1)
    assert (result["encoder"], result["decoder"], result["test_encoder"]) == ("lsw_sr", "e2e_cnn", "lsw_sr")
    assert len(result["scenes"]) == 2
    for metric in ("psnr", "ssim", "qscore"):
        values = [scene[metric] for scene in result["scenes"].values()]
        assert result["mean"][metric] == pytest.approx(np.mean(values))
        assert result["baseline"][metric] > 0
    assert set(result["mean"]) == {"psnr", "ssim", "qscore"}
    assert result["conventions"]["qscore"].startswith("Q of HDR-VDP-2.2.2, luma-display, 30 pixels")
    assert result["parameters"] > 0 and result["macs"] > 0 and result["seconds_per_measurement"] > 0
    assert result["device"].startswith("cpu")
    checkpoint = torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)
    assert result["training_steps"] == checkpoint["global_step"] > 0
    assert result["config"]["encoder"]["mask"]["bits"] == 4


def test_everything_is_where_the_summary_says(run: Path) -> None:
    for name in ("checkpoints/last.ckpt", "checkpoints/best.ckpt", "pictures/mask.png", "train.log"):
        assert (run / name).stat().st_size > 0 or name == "train.log"
    assert list((run / "pictures").glob("scene_*.png"))
    assert (run / ".hydra" / "config.yaml").is_file()


def test_dashboard(run: Path) -> None:
    board = EventAccumulator(str(run / "tensorboard" / "lsw_sr_4bit_e2e_cnn"), size_guidance={"images": 0}).Reload()
    tags = board.Tags()
    for scalar in ("train/loss", "train/lr", "train/clips_per_second", "val/psnr", "val/ssim", "val/qscore"):
        assert scalar in tags["scalars"], tags["scalars"]
    for metric in ("psnr", "ssim", "qscore"):
        assert any(tag.startswith(f"val_{metric}/") for tag in tags["scalars"])
    assert "mask" in tags["images"] and any(tag.startswith("scene/") for tag in tags["images"])
    assert [image.step for image in board.Images("mask")] == [0, 4, 8]  # before the first step, after each epoch
    assert any("hparams" in tag for tag in board.summary_metadata)


def test_the_dashboard_opens_on_what_matters_and_runs_share_their_charts(run: Path) -> None:
    """TensorBoard sorts groups of tags by name, opens the first two, and draws one chart for every tag."""
    board = EventAccumulator(str(run / "tensorboard" / "lsw_sr_4bit_e2e_cnn"), size_guidance={"images": 0}).Reload()
    tags = board.Tags()
    groups = sorted({tag.partition("/")[0] for kind in ("scalars", "images") for tag in tags[kind]})
    assert groups[:2] == ["curves", "mask"]
    assert [tag for tag in tags["scalars"] if tag.startswith("curves/")] == ["curves/loss", "curves/psnr"]
    for tag, source in (("curves/loss", "train/loss"), ("curves/psnr", "val/psnr")):
        assert [event.value for event in board.Scalars(tag)] == [event.value for event in board.Scalars(source)]
    assert not any("lsw_sr" in tag or "bit" in tag for tag in tags["scalars"])
    assert "custom_scalars__config__" not in tags["tensors"]  # whose charts stay empty in a browser


def test_images_of_the_dashboard_fill_their_cards(run: Path) -> None:
    """A card is about 380 x 220 pixels; of a picture of eight columns nothing could be made out in it."""
    board = EventAccumulator(str(run / "tensorboard" / "lsw_sr_4bit_e2e_cnn"), size_guidance={"images": 0}).Reload()
    for tag in board.Tags()["images"]:
        image = board.Images(tag)[-1]
        assert 1.5 < image.width / image.height < 2 and image.width >= 380


def test_the_mask_was_learned_and_stayed_in_range(run: Path) -> None:
    checkpoint = read_checkpoint(run / "checkpoints" / "last.ckpt")
    weight = checkpoint.state["encoder.mask.weight"]
    assert weight.min() >= 0 and weight.max() <= 1
    from sci_lightning.encoder.mask import LearnedStructural

    assert not torch.equal(weight, LearnedStructural(4, 8, (32, 32)).weight)
    assert torch.equal(checkpoint.encoder().mask().sum(0), torch.ones(32, 32))


def test_evaluate_with_the_trained_and_with_another_encoder(run: Path, command: Command, tmp_path: Path) -> None:
    ckpt = f"ckpt_path={run}/checkpoints/last.ckpt"
    scenes = ["data=synthetic", "data.scenes_count=2"]
    done = command("evaluate", ckpt, *scenes, "out=a")
    assert done.returncode == 0, done.stderr
    trained = json.loads((run / "metrics.json").read_text())
    result = json.loads((tmp_path / "a" / "metrics.json").read_text())
    assert result["mean"] == pytest.approx(trained["mean"], abs=1e-6)
    assert result["test_encoder"] == "lsw_sr"

    done = command("evaluate", ckpt, "encoder=rbw_sr", *scenes, "metrics.qscore=null", "out=b")
    assert done.returncode == 0, done.stderr
    assert "Q-Score" not in done.stdout
    other = json.loads((tmp_path / "b" / "metrics.json").read_text())
    assert (other["encoder"], other["test_encoder"]) == ("lsw_sr", "rbw_sr")
    assert other["mean"]["psnr"] < result["mean"]["psnr"]
    assert "qscore" not in other["mean"] and not other["conventions"]

    convention = ["metric=[psnr,qscore]", "metrics.qscore.encoding=sRGB-display", "metrics.qscore.pixels_per_degree=40"]
    done = command("evaluate", ckpt, *scenes, *convention, "out=c")
    assert done.returncode == 0, done.stderr
    assert "sRGB-display, 40 pixels per degree" in " ".join(done.stdout.split())
    other = json.loads((tmp_path / "c" / "metrics.json").read_text())
    assert set(other["mean"]) == {"psnr", "qscore"} and other["mean"]["qscore"] != result["mean"]["qscore"]

    done = command("evaluate", ckpt, *scenes, "size=[48,48]", "out=d")  # before the scenes are looked at
    assert done.returncode == 2 and "size=[48, 48]: the mask has 32 x 32" in done.stderr
    assert not (tmp_path / "d" / "metrics.json").exists()


@pytest.mark.slow
def test_evaluate_on_the_benchmark(run: Path, command: Command, tmp_path: Path, shared_data: Path) -> None:
    """At 256 x 256 after training on 32 x 32: a small mask cannot be stretched, so it is refused and the way named."""
    done = command("evaluate", f"ckpt_path={run}/checkpoints/last.ckpt", f"data.root={shared_data}/benchmark")
    assert done.returncode == 2
    assert "(256, 256)" in done.stderr and "(32, 32)" in done.stderr
    right = "add 'size=[256,256]' encoder=lsw_sr 'encoder.mask.tile=[32,32]' encoder.mask.bits=4"
    assert done.stderr.endswith(f"{right}\n")
    few = ["data=six_scenes", "data.scenes=[drop]", "metrics.qscore=null", "pictures=0"]
    few += [f"ckpt_path={run}/checkpoints/last.ckpt", f"data.root={shared_data}/benchmark"]
    done = command("evaluate", *few, *shlex.split(right)[1:])
    assert done.returncode == 0, done.stderr
    done = command("evaluate", *few, "encoder=rbw_sr")  # its random mask takes any size
    assert done.returncode == 2 and done.stderr.endswith("; add 'size=[256,256]'\n")
    done = command("evaluate", *few, "encoder=lsw_sr", "encoder.mask.tile=[8,8]")
    assert done.returncode == 2 and "encoder.mask.tile=null" in done.stderr
    tiled = [*TINY, "size=[256,256]", "crop=[32,32]", "encoder.mask.tile=[32,32]", "data.scenes_count=1"]
    limits = [f"benchmark.root={shared_data}/benchmark", "benchmark.scenes=[runner,drop]", "trainer.max_epochs=1"]
    done = command("train", *tiled, *limits, "data.snapshots_per_scene=1", "out=run")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert set(result["scenes"]) == {"runner", "drop"}


def test_reconstruct(run: Path, command: Command, tmp_path: Path) -> None:
    snapshot = (torch.rand(2, 32, 32) * 255).byte().numpy()
    np.save(tmp_path / "snapshot.npy", snapshot)
    ckpt = f"ckpt_path={run}/checkpoints/last.ckpt"
    done = command("reconstruct", ckpt, "measurement=snapshot.npy", "precision=32", "out=a")
    assert done.returncode == 0, done.stderr
    video = np.load(tmp_path / "a" / "reconstruction.npy", allow_pickle=False)
    assert video.shape == (2, 8, 32, 32)
    assert len(list((tmp_path / "a" / "frames").glob("*.png"))) == 16
    assert (tmp_path / "a" / "video.gif").read_bytes()[:3] == b"GIF"
    checkpoint = read_checkpoint(run / "checkpoints" / "last.ckpt")
    with torch.no_grad():
        expected = checkpoint.decoder()(torch.from_numpy(snapshot / np.float32(255)), checkpoint.encoder().mask())
    np.testing.assert_allclose(video, expected.numpy(), atol=1e-5)

    mask = np.full((8, 40, 24), 1 / 8)
    np.save(tmp_path / "mask.npy", mask)
    np.save(tmp_path / "other.npy", np.random.default_rng(0).random((40, 24)))
    done = command("reconstruct", ckpt, "measurement=other.npy", "mask=mask.npy", "out=b")
    assert done.returncode == 0, done.stderr
    assert np.load(tmp_path / "b" / "reconstruction.npy").shape == (1, 8, 40, 24)
    done = command("reconstruct", ckpt, "measurement=other.npy", "out=c")
    assert done.returncode == 2 and "mask=FILE" in done.stderr


def test_other_ways_to_train(command: Command, tmp_path: Path) -> None:
    """Windows of a larger mask, a folder of clips, noise, root loss, a measured mask, no logger."""
    np.save(tmp_path / "mask.npy", np.random.default_rng(0).random((8, 48, 48)))
    tiny = [each for each in TINY if not each.startswith("size")]
    folder = ["data=folder", f"data.root={clips(tmp_path / 'clips', 'folder')}", "data.store=store", "crop=[32,32]"]
    noise = ["encoder.sensor.full_well=5000", "encoder.sensor.read_noise=1.5", "encoder.sensor.bit_depth=10"]
    measured = ["encoder=rbw_sr", "encoder/mask=measured", "encoder.mask.file=mask.npy"]
    rest = ["size=[48,48]", "system.loss=rmse", "logger=none", "callbacks.pictures=null", "out=run"]
    done = command("train", *tiny, *folder, *noise, *measured, *rest)
    assert done.returncode == 0, done.stderr
    (tmp_path / "mask.npy").unlink()  # the checkpoint holds what was measured
    done = command("evaluate", "ckpt_path=run/checkpoints/last.ckpt", *folder[:3], "out=again")
    assert done.returncode == 0, done.stderr
    first, again = (json.loads((tmp_path / name / "metrics.json").read_text()) for name in ("run", "again"))
    assert again["mean"] == pytest.approx(first["mean"], abs=1e-6)


@pytest.mark.slow
def test_sweep(command: Command, tmp_path: Path) -> None:
    done = command("train", "-m", *TINY, "encoder.mask.bits=1,3", "trainer.max_epochs=1", "out=sweep")
    assert done.returncode == 0, done.stderr
    bits = [
        json.loads((tmp_path / "sweep" / job / "metrics.json").read_text())["config"]["encoder"]["mask"]["bits"]
        for job in "01"
    ]
    assert bits == [1, 3]


def test_commands_are_listed(command: Command) -> None:
    done = command("")
    for name in ("train", "evaluate", "reconstruct"):
        assert f"python -m sci_lightning.{name} " in done.stdout


@pytest.mark.slow
def test_a_network_that_begins_with_the_linear_estimate(
    command: Command, ran: Callable[..., str], tmp_path: Path
) -> None:
    """It starts far above the mean measurement, and its checkpoint brings the linear estimate back."""
    slow = ["system.lr=1e-6", "trainer.max_epochs=1", "metrics.qscore=null", "logger=none", "encoder.mask.tile=[8,8]"]
    start = [*TINY, *slow, "decoder.first_estimate=linear", "trainer.precision=bf16-mixed", "out=run"]
    done = command("train", *start)
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["config"]["decoder"]["first_estimate"] == "linear"
    assert metrics["mean"]["psnr"] > metrics["baseline"]["psnr"]
    ran("evaluate", "ckpt_path=run/checkpoints/last.ckpt", "data=synthetic", "metrics.qscore=null", "out=again")
    again = json.loads((tmp_path / "again" / "metrics.json").read_text())
    assert again["mean"]["psnr"] == pytest.approx(metrics["mean"]["psnr"], abs=0.5)
