"""Published weights become checkpoints that the other commands take; checkpoints become safetensors."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from sci_lightning.decoder import E2ECNN
from sci_lightning.encoder.mask.structure import structure
from sci_lightning.runs.checkpoint import read_checkpoint
from tests.decoder.transcriptions import as_published, random_state
from tests.training.small_training import TINY

Run = Refused = Callable[..., str]
DECODER = ["decoder=e2e_cnn", "decoder.channels=6"]


@pytest.fixture
def published(tmp_path: Path) -> dict[str, torch.Tensor]:
    """``wrapper.pth``, of the deep-optics code at 8 x 32 x 32, and ``bare.pth``; returns the decoder's state."""
    state, real = random_state(E2ECNN(8, channels=6)), torch.rand(8, 32, 32)
    wrapper = {"encoder.weight": structure(real, 3), **{f"decoder.{key}": value for key, value in state.items()}}
    beside = {"pretrain_epoch": 7, "continuous_mask": real, "optimizer": {"param_groups": [{"lr": 1e-4}]}}
    torch.save({**beside, "state_dict": wrapper}, tmp_path / "wrapper.pth")
    torch.save({f"module.{key}": value for key, value in state.items()}, tmp_path / "bare.pth")
    save_file(state, tmp_path / "bare.safetensors")
    return state


@pytest.mark.parametrize("out", ["out.ckpt", "out.safetensors"])
def test_the_wrapper_brings_its_mask(out: str, published: dict[str, torch.Tensor], ran: Run, tmp_path: Path) -> None:
    told = ran("convert", "checkpoint=wrapper.pth", *DECODER, f"out={out}")
    assert "encoder=lsw_sr" in told and out in told
    file = torch.load(tmp_path / "wrapper.pth", weights_only=True)
    checkpoint = read_checkpoint(tmp_path / out)
    encoder, decoder = checkpoint.encoder(), checkpoint.decoder()
    assert torch.equal(encoder.transmittance(), file["state_dict"]["encoder.weight"])
    assert torch.equal(encoder.mask.weight, file["continuous_mask"]) and encoder.mask.bits == 3
    assert all(torch.equal(value, published[key]) for key, value in as_published(decoder).items())
    assert checkpoint.config["names"] == {"encoder": "lsw_sr", "decoder": "e2e_cnn"}

    ran("evaluate", f"ckpt_path={out}", "data=synthetic", "data.scenes_count=1", "trainer.accelerator=cpu", "out=run")
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["config"]["converted"] == "wrapper.pth"
    np.save(tmp_path / "snapshot.npy", np.full((32, 32), 0.5))
    ran("reconstruct", f"ckpt_path={out}", "measurement=snapshot.npy", "device=cpu", "out=run")
    assert np.load(tmp_path / "run" / "reconstruction.npy").shape == (1, 8, 32, 32)


def test_training_starts_from_it(published: dict[str, torch.Tensor], ran: Run, tmp_path: Path) -> None:
    ran("convert", "checkpoint=bare.safetensors", *DECODER, "size=[32,32]", "encoder=lsw_sr", "out=start.ckpt")
    short = [
        *TINY,
        *DECODER,
        "decoder.blocks=5",
        "data.clips_per_epoch=2",
        "data.scenes_count=1",
        "trainer.max_epochs=1",
    ]
    ran("train", *short, "ckpt_path=start.ckpt", "out=run")
    last = read_checkpoint(tmp_path / "run" / "checkpoints" / "last.ckpt")
    moved = (last.state["decoder.first.weight"] - published["conv1.weight"]).abs().max()
    assert 0 < moved < 0.001 and last.resumable  # one step of Adam away

    ran("convert", "checkpoint=run/checkpoints/last.ckpt", "out=run.safetensors")
    assert read_checkpoint(tmp_path / "run.safetensors").config == last.config
    with safe_open(tmp_path / "run.safetensors", framework="pt") as file:
        assert set(file.keys()) == set(last.state)
        assert all(torch.equal(file.get_tensor(key), value) for key, value in last.state.items())


def test_a_binary_mask_is_kept_as_it_is(published: dict[str, torch.Tensor], ran: Run, tmp_path: Path) -> None:
    levels = (torch.rand(8, 16, 16) < 0.5).float()
    wrapper = {"encoder.weight": levels, **{f"decoder.{key}": value for key, value in published.items()}}
    torch.save({"state_dict": wrapper, "continuous_mask": torch.rand(8, 16, 16)}, tmp_path / "binary.pth")
    assert "encoder=rbw_sr: the file's mask" in ran("convert", "checkpoint=binary.pth", *DECODER, "out=out.ckpt")
    encoder = read_checkpoint(tmp_path / "out.ckpt").encoder()
    assert torch.equal(encoder.transmittance(), levels) and encoder.sensor.bit_depth == 8


def test_without_a_mask(published: dict[str, torch.Tensor], ran: Run, tmp_path: Path) -> None:
    told = ran("convert", "checkpoint=bare.pth", *DECODER, "size=[16,24]", "out=out.ckpt")
    assert "encoder=rbw_osr: no mask in the file" in told
    assert read_checkpoint(tmp_path / "out.ckpt").encoder().transmittance().shape == (8, 16, 24)
    np.save(tmp_path / "mask.npy", np.full((8, 16, 24), 0.25))
    mine = ["encoder=rbw_sr", "encoder/mask=measured", "encoder.mask.file=mask.npy", "size=[16,24]"]
    assert "random" not in ran("convert", "checkpoint=bare.pth", *DECODER, *mine, "out=out.ckpt")
    encoder = read_checkpoint(tmp_path / "out.ckpt").encoder()
    assert (encoder.transmittance() == 0.25).all() and encoder.sensor.bit_depth == 8


def test_bad_input(published: dict[str, torch.Tensor], refused: Refused, tmp_path: Path) -> None:
    def line(checkpoint: str, *overrides: str) -> str:
        result = refused("convert", f"checkpoint={checkpoint}", "out=out.ckpt", *(overrides or DECODER))
        assert checkpoint in result and not (tmp_path / "out.ckpt").exists()
        return result

    assert "no such file" in line("absent.pth")
    assert "name it: decoder=NAME" in line("bare.pth", "seed=1")
    assert "'conv1.weight' has no place in Res2former" in line("bare.pth", "decoder=res2former", "decoder.dim=16")
    assert "set frames= and decoder.*" in line("bare.pth", "decoder=e2e_cnn", "decoder.channels=8")
    assert "set frames= and decoder.*" in line("bare.pth", *DECODER, "frames=10")
    assert "'encoder.weight', is (8, 32, 32)" in line("wrapper.pth", *DECODER, "size=[24,24]")
    for name in ("wrapper.pth", "bare.safetensors"):
        (tmp_path / f"cut_{name}").write_bytes((tmp_path / name).read_bytes()[:5000])
        assert "damaged or truncated" in line(f"cut_{name}")
    (tmp_path / "notes.pth").write_text("not weights")
    assert "not a readable checkpoint" in line("notes.pth")
    torch.save(torch.nn.Linear(2, 2), tmp_path / "whole.pth")
    assert "refused, nothing was executed" in line("whole.pth")
    torch.save([torch.ones(2)], tmp_path / "list.pth")
    assert "not a dictionary" in line("list.pth")
    torch.save({**published, "fc.weight": torch.ones(2)}, tmp_path / "more.pth")
    assert "'fc.weight' has no place" in line("more.pth")
    torch.save({key: value for key, value in published.items() if key != "conv1.bias"}, tmp_path / "less.pth")
    assert "'conv1.bias' ('first.bias' here) is missing" in line("less.pth")


def test_our_own_needs_no_name(published: dict[str, torch.Tensor], ran: Run, refused: Refused) -> None:
    ran("convert", "checkpoint=wrapper.pth", *DECODER, "out=ours.ckpt")
    assert "leave decoder= out" in refused("convert", "checkpoint=ours.ckpt", *DECODER, "out=out.ckpt")


def test_numbers_of_numpy_beside_the_weights(published: dict[str, torch.Tensor], ran: Run, tmp_path: Path) -> None:
    """Scores that a training script kept; plain values, though not Python's."""
    torch.save({"state_dict": published, "best_psnr": np.float64(35.2), "epoch": np.int64(9)}, tmp_path / "scored.pth")
    assert "49 tensors" in ran("convert", "checkpoint=scored.pth", *DECODER, "size=[16,16]", "out=out.ckpt")
