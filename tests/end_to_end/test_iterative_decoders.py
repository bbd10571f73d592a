"""Iterative decoders: used without a checkpoint, or with a denoiser that was trained by itself."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.decoder.denoiser import FFDNet
from tests.conftest import next_lines

Run = Callable[..., str]
SHORT = ["decoder.iterations=[3]", "frames=4", "size=[32,32]"]
SCENE = ["data=synthetic", "data.scenes_count=1", "trainer.accelerator=cpu", "metric=[psnr]", "out=run"]


@pytest.mark.usefixtures("short_pictures")
@pytest.mark.parametrize("decoder", ["gap_tv", "admm_tv"])
def test_evaluate(ran: Run, tmp_path: Path, decoder: str) -> None:
    told = ran("evaluate", f"decoder={decoder}", *SHORT, *SCENE)
    for line in next_lines(told) if decoder == "gap_tv" else ():  # runs as it stands
        module, *words = shlex.split(line)[2:]
        ran(module.removeprefix("sci_lightning."), *words)
    assert f"{decoder}, tested on rbw_osr" in told and "trained on" not in told
    result = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (result["encoder"], result["decoder"], result["test_encoder"]) == ("rbw_osr", decoder, "rbw_osr")
    assert result["mean"]["psnr"] > result["baseline"]["psnr"] and result["parameters"] == 0
    assert result["config"]["decoder"]["iterations"] == [3] and result["config"]["size"] == [32, 32]


def test_evaluate_in_tiles(ran: Run, refused: Run, tmp_path: Path) -> None:
    """The same figures in tiles as at once, with another camera than the one that records, too."""
    scores = []
    for tile in ("none", "[16,12]"):
        ran("evaluate", "decoder=gap_tv", "decoder.camera=rbw_sr", f"tile={tile}", *SHORT, *SCENE)
        scores.append(json.loads((tmp_path / "run" / "metrics.json").read_text())["mean"]["psnr"])
    assert abs(scores[0] - scores[1]) < 1e-4
    line = refused("evaluate", "decoder=gap_tv", "tile=[16,2]", *SHORT, *SCENE)
    assert "tile=[16,2]" in line and "halo of 4" in line


def test_with_an_encoder(ran: Run, tmp_path: Path) -> None:
    ran("evaluate", "decoder=gap_tv", "encoder=rsw_sr", "effect=[gain]", *SHORT, *SCENE)
    result = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert result["encoder"] == result["test_encoder"] == "rsw_sr" and result["mean"]["psnr"] > 15
    np.save(tmp_path / "mask.npy", (np.random.default_rng(0).random((4, 32, 32)) < 0.5).astype("float32"))
    ran(
        "evaluate",
        "decoder=gap_tv",
        "encoder=rbw_osr",
        "encoder/mask=measured",
        "encoder.mask.file=mask.npy",
        *SHORT,
        *SCENE,
    )


def test_reconstruct(ran: Run, tmp_path: Path) -> None:
    np.save(tmp_path / "snapshot.npy", np.full((32, 32), 0.5, np.float32))
    np.save(tmp_path / "mask.npy", (np.random.default_rng(0).random((4, 32, 32)) < 0.5).astype("float32"))
    given = ["measurement=snapshot.npy", "mask=mask.npy"]
    ran("reconstruct", "decoder=gap_tv", *SHORT, *given, "device=cpu", "out=run")
    video = np.load(tmp_path / "run" / "reconstruction.npy")
    assert video.shape == (1, 4, 32, 32) and np.isfinite(video).all()


def test_refused(refused: Run) -> None:
    line = refused("evaluate", *SCENE)
    assert "ckpt_path=" in line and "decoder=gap_tv" in line
    line = refused("evaluate", "decoder=e2e_cnn", *SCENE)
    assert "decoder=e2e_cnn has 817,608 parameters to learn" in line
    assert "no such file" in refused("evaluate", "decoder=gap_tv", "ckpt_path=no.ckpt", *SCENE)
    line = refused("evaluate", "decoder=gap_tv", "decoder.strengths=[0]", *SCENE)
    assert "decoder.strengths=[0]: expected a list" in line
    line = refused("evaluate", "decoder=gap_tv", "decoder.motion=5", *SCENE)
    assert "decoder.motion=5: expected a MotionFilter or null" in line
    assert "decoder=gap_tv has nothing to learn" in refused("train", "decoder=gap_tv")


def test_interrupted(ran: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sci_lightning.decoder.GAP.decode", stop)
    with pytest.raises(SystemExit) as caught:
        ran("evaluate", "decoder=gap_tv", *SHORT, *SCENE)
    assert caught.value.code == 130 and not (tmp_path / "run" / "metrics.json").exists()


@pytest.mark.slow
def test_a_denoiser_is_trained_by_itself(ran: Run, refused: Run, tmp_path: Path) -> None:
    small = ["decoder.denoiser.channels=8", "decoder.denoiser.layers=4", "decoder.iterations=[1]", *SHORT[1:]]
    quick = ["data=synthetic", "data.clips_per_epoch=4", "workers=0", "trainer.max_epochs=1", "trainer.accelerator=cpu"]
    ran("train", "system=denoiser", "decoder=pnp_ffdnet", *small, *quick, "metric=[psnr]", "out=trained")
    trained = "ckpt_path=trained/checkpoints/last.ckpt"
    ran("evaluate", trained, *SCENE)
    as_trained = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert as_trained["decoder"] == "pnp_ffdnet" and as_trained["mean"]["psnr"] > 10
    ran(
        "evaluate",
        trained,
        "decoder=pnp_ffdnet",
        *small[:2],
        "decoder.strengths=[0.1]",
        "decoder.iterations=[1]",
        *SCENE,
    )
    otherwise = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert otherwise["mean"]["psnr"] != as_trained["mean"]["psnr"]
    assert "does not fit decoder=pnp_ffdnet as configured" in refused("evaluate", trained, "decoder=pnp_ffdnet", *SCENE)
    line = refused("evaluate", trained, "+decoder.motion=null", *SCENE)
    assert "needs a decoder as well" in line and "decoder=pnp_ffdnet" in line
    assert "E2ECNN has no denoiser" in refused("train", "system=denoiser", "decoder=e2e_cnn", *SHORT[1:])


def test_weights_that_are_none_of_the_denoiser(refused: Run, tmp_path: Path) -> None:
    small = ["decoder=pnp_ffdnet", "decoder.denoiser.channels=8", "decoder.denoiser.layers=4"]
    state = FFDNet(8, 4).state_dict()
    theirs = {key.replace("net.", "intermediate_dncnn.itermediate_dncnn.", 1): value for key, value in state.items()}

    def line(name: str, weights: dict[str, torch.Tensor]) -> str:
        torch.save(weights, tmp_path / name)
        told = refused("convert", f"checkpoint={name}", *small, "out=out.ckpt")
        assert name in told and not (tmp_path / "out.ckpt").exists()
        return told

    last = "intermediate_dncnn.itermediate_dncnn.8.weight"
    less = {key: value for key, value in theirs.items() if key != last}
    assert f"'{last}' ('denoiser.net.8.weight' here) is missing" in line("less.pth", less)
    assert "has no place" in line("more.pth", {**theirs, "head.weight": torch.ones(2)})
    assert "set frames= and decoder.*" in line("wide.pth", {**theirs, last: torch.ones(4, 9, 3, 3)})
    torch.save(theirs, tmp_path / "good.pth")
    assert "has no place in GAP" in refused("convert", "checkpoint=good.pth", "decoder=gap_tv", "out=out.ckpt")


def test_settings_that_do_not_converge(refused: Run, tmp_path: Path) -> None:
    np.save(tmp_path / "snapshot.npy", np.full((32, 32), 0.5, np.float32))
    np.save(tmp_path / "mask.npy", np.full((4, 32, 32), 0.25, np.float32))
    steep = ["decoder=gap_tv", *SHORT, "decoder.strengths=[1e-40]", "mask=mask.npy"]
    line = refused("reconstruct", *steep, "measurement=snapshot.npy", "device=cpu")
    assert re.search("iteration 1 of 3: .*nan", line) and "decoder.strengths" in line
