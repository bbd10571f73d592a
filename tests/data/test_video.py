"""A video read in one call, from every kind of file and folder that the data sources read."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from PIL import Image
from scipy.io import savemat

from sci_lightning.data.video import load_video
from sci_lightning.errors import BadInput

FRAMES = np.random.default_rng(0).integers(0, 256, (10, 24, 32), dtype=np.uint8)


def npz(path: Path) -> Path:
    np.savez(path / "clip.npz", frames=FRAMES)
    return path / "clip.npz"


def floats(path: Path) -> Path:
    np.savez(path / "clip.npz", FRAMES / np.float32(255))
    return path / "clip.npz"


def folder(path: Path) -> Path:
    (path / "clip").mkdir()
    for number, frame in enumerate(FRAMES):
        Image.fromarray(frame).save(path / "clip" / f"{number}.png")
    return path / "clip"


def folder_of_one_clip(path: Path) -> Path:
    folder(path)
    return path


def mat(path: Path) -> Path:
    savemat(path / "scene.mat", {"orig": FRAMES.transpose(1, 2, 0), "mask": np.ones((24, 32, 8))})
    return path / "scene.mat"


def npy(path: Path) -> Path:
    np.save(path / "clip.npy", FRAMES)
    return path / "clip.npy"


def hdf5(path: Path) -> Path:
    with h5py.File(path / "clip.h5", "w") as file:
        file["orig"] = FRAMES
    return path / "clip.h5"


@pytest.mark.parametrize("write", [npz, floats, folder, folder_of_one_clip, mat, npy, hdf5])
def test_the_same_frames_out_of_every_kind(write: type, tmp_path: Path) -> None:
    path = write(tmp_path)
    whole = load_video(path)
    assert whole.dtype == torch.float32 and torch.equal(whole[0], torch.from_numpy(FRAMES) / 255)
    groups = load_video(path, 4, size=(8, 16))
    assert torch.equal(groups, whole[:, :8, 8:16, 8:24].reshape(2, 4, 8, 16))
    assert torch.equal(load_video(path, 4, snapshots=1), whole[:, :4])


def test_a_video_file(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    with av.open(str(tmp_path / "clip.mp4"), "w") as file:
        stream = file.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = 32, 24, "yuv420p"
        for level in range(10):
            gray = np.full((24, 32, 3), 20 * level, np.uint8)
            file.mux(stream.encode(av.VideoFrame.from_ndarray(gray, format="rgb24")))
        file.mux(stream.encode())
    video = load_video(tmp_path / "clip.mp4", 5)
    assert video.shape == (2, 5, 24, 32)
    assert torch.allclose(video.mean((2, 3)).flatten(), torch.arange(10) * 20 / 255, atol=0.02)


def test_what_cannot_be_read_is_said(tmp_path: Path) -> None:
    path = npz(tmp_path)
    (tmp_path / "more").mkdir()
    npz(tmp_path / "more")
    savemat(tmp_path / "two.mat", {"a": FRAMES, "b": FRAMES})
    for source, settings, line in (
        (tmp_path / "none.mp4", {}, "no such file"),
        (tmp_path, {}, "2 clips"),
        (path, {"frames": 11}, "10 frames, fewer than the 11"),
        (path, {"frames": 0}, "frames=0"),
        (path, {"snapshots": 2}, "how many frames"),
        (path, {"size": (48, 48)}, "24 x 32"),
        (path, {"key": "others"}, "others"),
        (tmp_path / "two.mat", {}, "a .*b "),
    ):
        with pytest.raises(BadInput, match=line):
            load_video(source, **settings)
