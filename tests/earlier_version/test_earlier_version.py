"""Files that version 0.1.0 wrote before the package was rearranged are opened by every command that takes them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

import sci_lightning

HERE = Path(__file__).parent


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A copy of the files, so that no command can change them."""
    return Path(shutil.copytree(HERE, tmp_path / "earlier"))


def test_checkpoint_in_a_notebook(files: Path) -> None:
    checkpoint = sci_lightning.load_checkpoint(files / "last.ckpt")
    encoder, decoder = checkpoint.encoder(), checkpoint.decoder()
    video = decoder(encoder(torch.rand(1, 4, 32, 32)), encoder.mask())
    assert video.shape == (1, 4, 32, 32)


def test_evaluate(files: Path, ran: Callable[..., str]) -> None:
    ran("evaluate", f"ckpt_path={files}/last.ckpt", "data=synthetic", f"out={files}/evaluated")
    then = json.loads((files / "metrics.json").read_text())["mean"]["psnr"]
    now = json.loads((files / "evaluated" / "metrics.json").read_text())["mean"]["psnr"]
    assert now == pytest.approx(then, abs=0.01)


def test_resume(files: Path, ran: Callable[..., str]) -> None:
    ran(
        "train", f"ckpt_path={files}/last.ckpt", f"out={files}/longer", "trainer.max_steps=5", "trainer.max_epochs=null"
    )
    assert (files / "longer" / "metrics.json").is_file()


@pytest.mark.slow
def test_tables(files: Path, ran: Callable[..., str]) -> None:
    assert "E2E-CNN" in ran("tables", f"runs={files}", f"out={files}/tables")


@pytest.mark.slow
def test_captures_and_report(files: Path, command: Callable[..., object]) -> None:
    command("diagnose", f"captures={files}/captures.h5", f"out={files}/out")
    then = json.loads((files / "found" / "report.json").read_text())
    now = json.loads((files / "out" / "report.json").read_text())
    assert [effect["name"] for effect in now["effects"]] == [effect["name"] for effect in then["effects"]] == ["gain"]
    done = command("virtual_camera.reveal", f"{files}/captures.truth.json", f"{files}/found/report.json")
    assert "gain" in done.stdout  # type: ignore[attr-defined]


def test_encoder_file(files: Path, ran: Callable[..., str]) -> None:
    ran(
        "train",
        f"encoder={files}/found/encoder.yaml",
        "decoder=gap_net",
        "decoder.channels=[4,8,16]",
        "decoder.stages=1",
        "data=synthetic",
        "metrics.qscore=null",
        "trainer.max_steps=1",
        f"out={files}/trained",
    )
