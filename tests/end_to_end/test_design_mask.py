"""The command that designs a mask: its files are read back, and what cannot be is one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from sci_lightning.encoder.mask import read_mask

QUICK = ["frames=3", "size=[12,10]", "tile=[4,4]", "steps=4", "out=run"]


@pytest.mark.parametrize("kind", [["bits=2"], ["bits=1"], ["kind=binary", "density=0.4", "full_well=1000"]])
def test_what_is_written(kind: list[str], ran: Callable[..., str], tmp_path: Path) -> None:
    printed = ran("design_mask", *QUICK, *kind)
    assert "expected PSNR" in printed and "encoder.mask.file" in printed
    assert "frames=3" in printed and "size=[12,10]" in printed  # the command works as it is printed
    mask = read_mask(tmp_path / "run" / "mask.npy")
    assert mask.shape == (3, 12, 10) and torch.equal(read_mask(tmp_path / "run" / "mask.mat"), mask)
    assert torch.equal(mask[:, 4:8], mask[:, :4]) and torch.equal(mask[..., 4:8], mask[..., :4])
    design = json.loads((tmp_path / "run" / "design.json").read_text())
    assert design["score_dB"] >= design["random_start_dB"] and design["settings"]["frames"] == 3
    assert (tmp_path / "run" / "mask.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ("kind=gray", "kind=gray: expected structural, binary"),
        ("bits=9", "from 1 to 8"),
        ("tile=[16,4]", "larger than the mask"),
        ("frames=1", "from 2 to 4096"),
        ("aperture=-1", "aperture=-1"),
        ("steps=0", "steps=0: expected a whole number from 1"),
        ("tile=[0,4]", "two positive whole numbers"),
        ("tile=[8]", "tile=[8]: expected two positive whole numbers"),
        ("frames=65", "frames=65: must be from 2 to 64"),
        ("read_noise=-1", "read_noise=-1"),
        ("full_well=0", "full_well=0"),
        ("bit_depth=40", "bit_depth=40"),
        ("prior=none.npz", "no such file"),
        ("frames=4096", "frames=4096: must be from 2 to 64"),
    ],
)
def test_what_is_refused(wrong: str, message: str, refused: Callable[..., str], tmp_path: Path) -> None:
    assert message in refused("design_mask", *QUICK, wrong)
    assert not (tmp_path / "run" / "mask.npy").exists()
