"""Animations show every frame for as long as was asked for, as far as the format can."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from PIL import Image

from sci_lightning.imaging.animation import write_gif


@pytest.mark.parametrize(("fps", "milliseconds"), [(8, 120), (50, 20), (0.1, 10_000)])
def test_durations(tmp_path: Path, fps: float, milliseconds: int) -> None:
    write_gif(torch.linspace(0, 1, 6).view(1, 6, 1, 1).expand(1, 6, 8, 8), tmp_path / "video.gif", fps)
    with Image.open(tmp_path / "video.gif") as gif:
        for frame in range(6):
            gif.seek(frame)
            assert gif.info["duration"] == milliseconds


def test_a_long_slow_animation_of_one_picture(tmp_path: Path) -> None:
    """Frames that are alike become one picture, whose duration must fit into the file."""
    write_gif(torch.zeros(10, 10, 8, 8), tmp_path / "video.gif", 0.1)
    with Image.open(tmp_path / "video.gif") as gif:
        assert 600_000 < gif.info["duration"] <= 655_350
