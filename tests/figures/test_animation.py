"""Animations show every frame for as long as was asked for, as far as the format can."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from sci_lightning.figures import animation
from sci_lightning.figures.animation import write_frames, write_gif, write_mp4, write_overview, write_side_by_side


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


def test_a_snapshot_stands_beside_every_frame_from_it(tmp_path: Path) -> None:
    video = torch.from_numpy(moving(2, 3, 16, 20))
    write_side_by_side(video.mean(1), video, tmp_path / "both.gif")
    with Image.open(tmp_path / "both.gif") as gif:
        assert gif.n_frames == 6 and gif.size == (2 * 20 + animation.GAP, 16 + animation.CAPTION)
        gif.seek(4)
        shown = np.asarray(gif.convert("L"), float)[animation.CAPTION :, -20:] / 255
    assert abs(shown - video[1, 1].numpy()).max() < 0.03


def moving(snapshots: int, slots: int, height: int, width: int) -> np.ndarray:
    """Noise, which no format packs."""
    return np.random.default_rng(0).random((snapshots, slots, height, width)).astype(np.float32)


def test_a_large_video_makes_small_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation, "GIF_PIXELS", 2**17)
    monkeypatch.setattr(animation, "MOST_FRAMES_SHOWN", 6)
    left_out = write_gif(moving(4, 2, 300, 400), tmp_path / "video.gif")
    assert "the first 6 of 8 frames" in left_out and "of 400 x 300 pixels" in left_out
    assert (tmp_path / "video.gif").stat().st_size < 1.5 * 2**17
    with Image.open(tmp_path / "video.gif") as gif:
        assert gif.n_frames == 6 and abs(gif.width / gif.height - 4 / 3) < 0.02
    assert write_gif(moving(1, 2, 20, 20), tmp_path / "small.gif") == ""


@pytest.mark.parametrize(("size", "fps"), [((33, 47), 8), ((64, 64), 0.1), ((1, 3), 50)])
def test_a_film(tmp_path: Path, size: tuple[int, int], fps: float) -> None:
    av = pytest.importorskip("av", reason="pip install sci-lightning[video]")
    video = np.linspace(0, 1, 6, dtype=np.float32).reshape(1, 6, 1, 1) * np.ones((1, 6, *size), np.float32)
    assert write_mp4(video, tmp_path / "video.mp4", fps)
    with av.open(str(tmp_path / "video.mp4")) as film:
        means = [frame.to_ndarray(format="gray").mean() for frame in film.decode(video=0)]
    assert len(means) == 6 and np.allclose(means, np.linspace(0, 255, 6), atol=6)


def test_no_film_without_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    assert not write_mp4(moving(1, 2, 8, 8), tmp_path / "video.mp4") and not list(tmp_path.iterdir())


def test_pictures_of_dark_videos(tmp_path: Path) -> None:
    write_frames(np.full((1, 1, 4, 4), 0.02, np.float32), tmp_path, white=0.04)
    with Image.open(tmp_path / "000_00.png") as shown:
        assert shown.getpixel((0, 0)) == 128


@pytest.mark.parametrize("shape", [(1, 2, 16, 16), (9, 28, 40, 500), (2, 8, 900, 1200)])
def test_an_overview_has_the_snapshot_beside_its_frames(tmp_path: Path, shape: tuple[int, ...]) -> None:
    video = moving(*shape)
    video[:, 0] = 1  # the first frame is white
    write_overview(video.sum(1), video, tmp_path / "overview.png")
    with Image.open(tmp_path / "overview.png") as shown:
        columns = min(shape[1], 8) + 1
        assert shown.width <= 1920 and shown.height < 1920 and shown.width % columns == 0
        side = shown.width // columns
        assert shown.crop((side, animation.CAPTION, 2 * side, animation.CAPTION + 5)).getextrema() == (255, 255)
        assert shown.crop((0, animation.CAPTION, side, animation.CAPTION + 5)).getextrema()[0] < 255
