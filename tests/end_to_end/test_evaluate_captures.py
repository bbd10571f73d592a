"""``evaluate captures=FILE``: a decoder is tested on what a camera recorded, with the encoder it takes it for."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.captures import Captures, read_captures
from sci_lightning.cli.composition import plain
from sci_lightning.decoder import GAPNet
from sci_lightning.metrics.psnr import psnr
from sci_lightning.runs.checkpoint import write_weights
from sci_lightning.virtual_camera import Session, VirtualCamera

Run = Callable[..., str]
HIDDEN = {"black_level": {"offset": 0.1}, "mask_shift": {"dx": 0.61, "dy": -0.35}}
TEST = ["ckpt_path=trained.ckpt", "captures=lab.h5", "metric=[psnr]", "trainer.accelerator=cpu"]


@pytest.fixture
def captures(tmp_path: Path) -> Captures:
    """``lab.h5``: 4 x 32 x 32, dimmed to a half, with something hidden; ``patterns.npy``: what was told."""
    session = Session((32, 32), frames=4, dark=1, flat=1, static=1, dynamic=2, aperture=0.5, surround="dark")
    VirtualCamera(session, HIDDEN).write(tmp_path / "lab.h5", seed=3)
    captures = read_captures(tmp_path / "lab.h5")
    np.save(tmp_path / "patterns.npy", captures.patterns[:4])
    return captures


@pytest.fixture
def trained(captures: Captures, configuration: Callable[..., DictConfig], tmp_path: Path) -> GAPNet:
    """The decoder of ``trained.ckpt``, whose encoder has the patterns and no effects."""
    mask = ["encoder/mask=measured", f"encoder.mask.file={tmp_path}/patterns.npy"]
    cfg = configuration("train", *mask, "decoder=gap_net", "frames=4", "size=[32,32]", "decoder.stages=2")
    encoder, decoder = (instantiate(cfg[part], _convert_="all") for part in ("encoder", "decoder"))
    state = {
        f"{name}.{key}": value
        for name, part in (("encoder", encoder), ("decoder", decoder))
        for key, value in part.state_dict().items()
    }
    write_weights(tmp_path / "trained.ckpt", {**plain(cfg), "names": {"encoder": "ideal", "decoder": "gap_net"}}, state)
    return decoder


@torch.no_grad()
@pytest.mark.parametrize("corrected", [False, True])
def test_scores(corrected: bool, captures: Captures, trained: Any, ran: Run, tmp_path: Path) -> None:
    told = torch.from_numpy(captures.patterns[:4])
    taken = torch.from_numpy(captures.measurement[-2:] / np.float32(255))
    encoder, mask = [], told
    if corrected:
        encoder = ["encoder=lsw_sr", "encoder/mask=measured", "encoder.mask.file=patterns.npy", "encoder.aperture=3"]
        encoder += ["effect=[black_level,pattern_order]", "encoder.effects.black_level.offset=0.1"]
        taken, mask = taken - 0.1, told.roll(1, 0)
    truth = torch.from_numpy(captures.scene[-2:])
    expected = psnr(trained(taken / 0.5, mask), truth).mean(1)  # the captures' aperture, not the encoder's

    assert "trained on ideal" in ran("evaluate", *TEST, *encoder, "precision=32", "out=run")
    result = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (result["encoder"], result["test_encoder"]) == ("ideal", "virtual camera")
    names = [f"capture_{len(captures) - 2}", f"capture_{len(captures) - 1}"]
    assert [result["scenes"][name]["psnr"] for name in names] == pytest.approx(expected.tolist(), abs=1e-3)
    assert result["config"]["evaluate"]["captures"] == "lab.h5"


def test_refusals(captures: Captures, trained: Any, ran: Run, refused: Run) -> None:
    assert "nowhere.h5: no such file" in refused("evaluate", TEST[0], "captures=nowhere.h5")
    assert "shows the encoder's mask" in refused("evaluate", *TEST, "encoder=rsw_sr")
    line = refused("evaluate", *TEST, "encoder=rsw_sr", "size=[16,16]")
    assert "captures of 4 x 32 x 32, the mask is 4 x 16 x 16" in line


CAMERA = """
_target_: sci_lightning.encoder.Encoder
mask: {_target_: sci_lightning.encoder.mask.Measured, file: patterns.npy}
sensor: {_target_: sci_lightning.encoder.sensor.ClipQuantise, bit_depth: 8}
aperture: 0.5
effects:
  shift: {_target_: sci_lightning.encoder.effects.MaskShift, dx: 0.61, dy: -0.35}
  black: {_target_: sci_lightning.encoder.effects.BlackLevel, offset: 0.1}
"""


@pytest.mark.slow
def test_a_camera_that_is_known(captures: Captures, ran: Run, refused: Run, tmp_path: Path) -> None:
    """A decoder without training, told what is wrong with the camera: of captures, of simulated scenes, of a file."""
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "encoder.yaml").write_text(CAMERA)
    (tmp_path / "patterns.npy").rename(tmp_path / "found" / "patterns.npy")
    told = ["encoder=rbw_osr", "encoder/mask=measured", "encoder.mask.file=found/patterns.npy"]
    known = "decoder.camera=found/encoder.yaml"
    decoder = ["decoder=gap_tv", "decoder.iterations=[20]", "frames=4", "size=[32,32]"]

    def score(*overrides: str) -> float:
        ran("evaluate", *decoder, *TEST[2:], *overrides, "out=run")
        return float(json.loads((tmp_path / "run" / "metrics.json").read_text())["mean"]["psnr"])

    taken = score("captures=lab.h5", known)
    assert taken > score("captures=lab.h5", *told) + 3
    assert taken == score("captures=lab.h5", "encoder=found/encoder.yaml")
    scene = ["data=synthetic", "data.scenes_count=1"]
    taken_for_ideal = score(*scene, "encoder=found/encoder.yaml", "decoder.camera=rbw_osr")
    assert score(*scene, "encoder=found/encoder.yaml", known) > taken_for_ideal + 3

    np.save(tmp_path / "snapshot.npy", captures.measurement[-1] / np.float32(255))
    truth = captures.scene[-1]

    def error(*overrides: str) -> float:
        ran("reconstruct", *decoder, "measurement=snapshot.npy", "device=cpu", *overrides, "out=run")
        return float(np.square(np.load(tmp_path / "run" / "reconstruction.npy")[0] - truth).mean())

    assert error(known) < 0.5 * error(*told, "aperture=0.5")
    assert "nowhere.yaml: no such encoder file" in refused("evaluate", *decoder, "decoder.camera=nowhere.yaml")
    (tmp_path / "found" / "encoder.yaml").write_text("_target_: os.system")
    assert "os.system" in refused("evaluate", *decoder, "captures=lab.h5", known)
