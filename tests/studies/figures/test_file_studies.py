"""Figures that are made of files alone: the range that real snapshots use, and how motion-aware a mask is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from sci_lightning.data.source import Scene
from sci_lightning.errors import BadInput
from sci_lightning.studies.tables.documented import measurements
from tests.studies.figures.capture_range import capture_range, range_of
from tests.studies.figures.motion_aware import awareness, motion_aware


def snapshot(folder: Path, name: str, brightest: int, texture: int) -> None:
    """Write a smooth picture with noise of ``texture`` DN."""
    noise = np.random.default_rng(0).integers(0, texture + 1, (128, 160))
    ramp = np.linspace(0, brightest - texture, 160).round().astype(int)
    folder.mkdir(exist_ok=True)
    Image.fromarray((ramp + noise).astype(np.uint8)).save(folder / f"{name}.png")


def test_range_of_snapshots(tmp_path: Path) -> None:
    for name in ("one", "two"):
        snapshot(tmp_path / "random", name, 140, 100)
        snapshot(tmp_path / "structural", name, 250, 10)
    snapshot(tmp_path / "structural", "only_here", 250, 10)
    capture_range(tmp_path, [tmp_path / "random", tmp_path / "structural"])
    table = measurements(tmp_path / "capture_range.json", "")
    assert [row[:2] for row in table.rows] == [[f, m] for f in ("one", "two") for m in ("random", "structural")]
    assert float(table.rows[0][3]) < 141 < 240 < float(table.rows[1][3])
    assert float(table.rows[0][-1]) > 0.2 > float(table.rows[1][-1])
    assert table.provenance.command.endswith("OUT random structural")
    with Image.open(tmp_path / "capture_range.png") as picture:
        assert picture.width > 1000
    snapshot(tmp_path / "other", "three", 200, 10)
    with pytest.raises(BadInput, match="no picture has the same name"):
        capture_range(tmp_path, [tmp_path / "random", tmp_path / "other"])


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


def test_motion_aware_masks(tmp_path: Path) -> None:
    for name, frames in (("a", 4), ("b", 4), ("c", 3)):
        np.save(tmp_path / f"{name}.npy", np.random.default_rng(1).random((frames, 32, 32), dtype=np.float32))
    motion_aware(tmp_path, None, [tmp_path / "a.npy", tmp_path / "b.npy"])
    rows = measurements(tmp_path / "motion_aware.json", "").rows
    assert [row[0] for row in rows] == ["a", "b", "open shutter"] and (tmp_path / "motion_aware.png").exists()
    with pytest.raises(BadInput, match="expected masks of one shape"):
        motion_aware(tmp_path, None, [tmp_path / "a.npy", tmp_path / "c.npy"])
