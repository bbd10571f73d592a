"""Figures that are made of files alone: the range that real snapshots use, and how motion-aware a mask is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from sci_lightning.data.source import Scene
from sci_lightning.studies.figures.capture_range import range_of
from sci_lightning.studies.figures.motion_aware import awareness
from sci_lightning.studies.tables.documented import measurements


def snapshot(folder: Path, name: str, brightest: int, texture: int) -> None:
    """Write a smooth picture with noise of ``texture`` DN."""
    noise = np.random.default_rng(0).integers(0, texture + 1, (128, 160))
    ramp = np.linspace(0, brightest - texture, 160).round().astype(int)
    folder.mkdir(exist_ok=True)
    Image.fromarray((ramp + noise).astype(np.uint8)).save(folder / f"{name}.png")


def test_range_of_snapshots(ran: Callable[..., str], refused: Callable[..., str], tmp_path: Path) -> None:
    for name in ("one", "two"):
        snapshot(tmp_path / "random", name, 140, 100)
        snapshot(tmp_path / "structural", name, 250, 10)
    snapshot(tmp_path / "structural", "only_here", 250, 10)
    assert "capture_range.json" in ran("tables", "dynamic_range=[random,structural]", "out=out")
    table = measurements(tmp_path / "out" / "capture_range.json", "")
    assert [row[:2] for row in table.rows] == [[f, m] for f in ("one", "two") for m in ("random", "structural")]
    assert float(table.rows[0][3]) < 141 < 240 < float(table.rows[1][3])
    assert float(table.rows[0][-1]) > 0.2 > float(table.rows[1][-1])
    assert "dynamic_range=[random,structural]" in table.provenance.command
    with Image.open(tmp_path / "out" / "capture_range.png") as picture:
        assert picture.width > 1000
    snapshot(tmp_path / "other", "three", 200, 10)
    assert "no picture has the same name" in refused("tables", "dynamic_range=[random,other]")


def test_range_of_one_snapshot() -> None:
    """An even picture has no detail; a checkerboard's is all fine."""
    even = range_of(np.full((32, 32), 255, np.uint16))
    assert even.pop("fine") == pytest.approx(0, abs=1e-9)
    assert even == {"levels": 1, "bright": 255.0, "mean": 255.0, "white": 100.0, "black": 0.0}
    board = 200 * (np.indices((32, 32)).sum(0) % 2)
    assert range_of(board)["fine"] == pytest.approx(1, abs=1e-3) and range_of(board)["levels"] == 2


def test_no_mask_is_more_motion_aware_than_none() -> None:
    """The error of the mean measurement is that of the photograph without a mask and the scene's motion together."""
    generator = torch.Generator().manual_seed(0)
    video = torch.rand(1, 4, 16, 16, generator=generator)
    scenes = [Scene("noise", video)]
    gray, binary = (
        torch.rand(4, 16, 16, generator=generator),
        (torch.rand(4, 16, 16, generator=generator) < 0.5).float(),
    )
    gray = (1 + 0.2 * gray) / (1 + 0.2 * gray).sum(0)
    shutter = awareness(torch.ones(4, 16, 16), scenes)
    assert shutter["photograph"] == 100
    by_mask = [awareness(mask, scenes) for mask in (gray, binary)]
    assert shutter["frames"] > by_mask[0]["frames"] > by_mask[1]["frames"]
    estimate = (gray * video[0]).sum(0)
    error = (estimate - video[0]).square().mean()
    parts = (estimate - video[0].mean(0)).square().mean() + (video[0].mean(0) - video[0]).square().mean()
    torch.testing.assert_close(error, parts)


def test_motion_aware_masks(ran: Callable[..., str], refused: Callable[..., str], tmp_path: Path) -> None:
    for name, frames in (("a", 4), ("b", 4), ("c", 3)):
        np.save(tmp_path / f"{name}.npy", np.random.default_rng(1).random((frames, 32, 32), dtype=np.float32))
    assert "open shutter" in ran("tables", "motion_aware=[a.npy,b.npy]", "out=out")
    assert len(measurements(tmp_path / "out" / "motion_aware.json", "").rows) == 3
    assert "expected masks of one shape" in refused("tables", "motion_aware=[a.npy,c.npy]")
