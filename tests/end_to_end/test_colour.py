"""Colour from end to end: clips through a simulated Bayer sensor, and colour files of other toolboxes."""

from __future__ import annotations

import json
import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from PIL import Image
from scipy.io import savemat
from tifffile import imwrite

from sci_lightning.cli.notebook import load_decoder
from sci_lightning.data import Folder
from sci_lightning.errors import InputWarning
from sci_lightning.runs.reconstruction import reconstruct

SIDE, SLOTS = 32, 4
QUICK = ["decoder=gap_tv", "decoder.iterations=[2]", "out=run"]
EVALUATE = [*QUICK, "encoder=rbw_sr", "encoder/sensor=bayer", "trainer.accelerator=cpu", "metrics.qscore=null"]
EVALUATE += ["encoder.aperture=1/T", "frames=4", "size=[32,32]"]
RECONSTRUCT = [*QUICK, "device=cpu", "bayer=grbg", "full_scale=255", "measurement=colour.mat"]


@pytest.fixture
def demosaicing() -> None:
    pytest.importorskip("colour_demosaicing", reason="pip install 'sci-lightning[colour]'")


@pytest.fixture
def frames() -> np.ndarray:
    """Eight frames ``(F, H, W, 3)``, uint8, in which red, green and blue differ and move."""
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    moving = [np.stack([x + 0.02 * t, 1 - x, 0.3 * np.sin(5 * y + 0.1 * t) + 0.5], -1) for t in range(2 * SLOTS)]
    return (200 * np.stack(moving)).clip(0, 255).astype(np.uint8)


@pytest.fixture
def arrays(frames: np.ndarray) -> dict[str, Any]:
    """What the toolboxes write, in MATLAB's order: a plain sum of frames from 0 to 255 behind a mask of 0 and 1."""
    mask = np.random.default_rng(0).integers(0, 2, (SIDE, SIDE, SLOTS)).astype(np.uint8)
    mosaic = frames[..., 1].copy()  # of the pattern grbg
    mosaic[:, ::2, 1::2], mosaic[:, 1::2, ::2] = frames[:, ::2, 1::2, 0], frames[:, 1::2, ::2, 2]
    turned = mosaic.transpose(1, 2, 0).astype(float)
    sums = [(mask * turned[..., first : first + SLOTS]).sum(-1) for first in (0, SLOTS)]
    orig = frames.transpose(1, 2, 3, 0)
    return {"meas_bayer": np.stack(sums, -1), "mask_bayer": mask, "orig": orig, "orig_bayer": turned}


def write_matlab73(path: Path, arrays: dict[str, Any]) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays.items():
            file[name] = values.T


@pytest.mark.parametrize("write", [savemat, write_matlab73], ids=["version 5", "version 7.3"])
def test_a_colour_file_of_a_toolbox(
    ran: Callable[..., str], arrays: dict[str, Any], frames: np.ndarray, demosaicing: None, tmp_path: Path, write: Any
) -> None:
    write(tmp_path / "colour.mat", arrays)
    printed = ran("reconstruct", *RECONSTRUCT, "decoder.iterations=[30]")
    video = np.load(tmp_path / "run" / "reconstruction.npy")
    truth = frames.reshape(2, SLOTS, SIDE, SIDE, 3) / 255
    assert video.shape == truth.shape and float(((video - truth) ** 2).mean()) < 0.003
    scores = {key: float(value) for key, value in re.findall(r"(psnr\w*|ssim\w*) ([\d.]+)", printed)}
    errors = ((video - truth) ** 2).mean((2, 3))
    expected = dict(zip(("red", "green", "blue"), (-10 * np.log10(errors)).mean((0, 1)), strict=True))
    assert {key: scores[f"psnr_{key}"] for key in expected} == pytest.approx(expected, abs=0.01)
    assert scores["psnr"] == pytest.approx(np.mean(list(expected.values())), abs=0.01) and 0 < scores["ssim_blue"] < 1
    for name in ("frames/001_03.png", "video.gif", "overview.png"):
        with Image.open(tmp_path / "run" / name) as picture:
            assert np.ptp(np.asarray(picture.convert("RGB")).astype(int), axis=-1).max() > 80, name


def test_a_mask_of_its_own_takes_the_place_of_the_files(
    ran: Callable[..., str], arrays: dict[str, Any], demosaicing: None, tmp_path: Path
) -> None:
    savemat(tmp_path / "mask.mat", {"mask": arrays.pop("mask_bayer")})
    savemat(tmp_path / "colour.mat", {"meas": arrays["meas_bayer"].astype(np.uint16)})
    printed = ran("reconstruct", *RECONSTRUCT, "mask=mask.mat")
    assert "psnr" not in printed and "seems to be a mosaic" not in printed
    assert np.load(tmp_path / "run" / "reconstruction.npy").shape == (2, SLOTS, SIDE, SIDE, 3)


def test_a_file_that_says_it_is_a_mosaic(arrays: dict[str, Any], demosaicing: None, tmp_path: Path) -> None:
    """A warning asks for the colours, unless they are given."""
    imwrite(tmp_path / "mosaic.tiff", (arrays["meas_bayer"][..., 0] / SLOTS).astype(np.uint8), photometric="cfa")
    savemat(tmp_path / "mask.mat", {"mask": arrays["mask_bayer"]})
    decoder = load_decoder("gap_tv", ["decoder.iterations=[2]"])
    given = {"mask": tmp_path / "mask.mat", "say": lambda line: None}
    with pytest.warns(InputWarning, match="give bayer=rggb"):
        assert reconstruct(tmp_path / "mosaic.tiff", decoder, **given).video.shape == (1, SLOTS, SIDE, SIDE)
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        result = reconstruct(tmp_path / "mosaic.tiff", decoder, bayer="grbg", **given)
    assert result.video.shape == (1, SLOTS, SIDE, SIDE, 3) and not result.scores


def test_what_reconstruct_refuses(
    refused: Callable[..., str],
    arrays: dict[str, Any],
    demosaicing: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def line(*overrides: str, **changed: Any) -> str:
        savemat(tmp_path / "colour.mat", {**arrays, **changed})
        return refused("reconstruct", *RECONSTRUCT, *overrides)

    assert "rggb" in line("bayer=rgb")
    odd = {name: arrays[name][:-1] for name in ("meas_bayer", "mask_bayer", "orig")}
    assert "31 x 32 pixels" in line(**odd) and "both even" in line(**odd)
    spoilt = arrays["meas_bayer"].copy()
    spoilt[3, 4, 0] = np.nan
    assert "NaN" in line(meas_bayer=spoilt)
    assert "values from nan" in line(orig=np.where(arrays["orig"] > 0, np.nan, 0.0))
    assert "orig is" in line(orig=arrays["orig"][..., :5])
    assert "even mask_origin" in line("mask_origin=[-1,0]", mask_bayer=arrays["mask_bayer"][:30])
    whole = (tmp_path / "colour.mat").read_bytes()
    (tmp_path / "colour.mat").write_bytes(whole[: len(whole) // 3])
    assert "truncated" in refused("reconstruct", *RECONSTRUCT)
    monkeypatch.setitem(sys.modules, "colour_demosaicing", None)
    assert "pip install 'sci-lightning[colour]'" in line()
    assert not (tmp_path / "run" / "reconstruction.npy").exists() and not (tmp_path / "run" / "frames").exists()


def test_channels_of_photographs_in_motion(ran: Callable[..., str], demosaicing: None, tmp_path: Path) -> None:
    ran("evaluate", *EVALUATE, "data=synthetic", "data.scenes_count=1")
    scene = json.loads((tmp_path / "run" / "metrics.json").read_text())["scenes"]["coffee"]
    assert set(scene) == {f"{name}{end}" for name in ("psnr", "ssim") for end in ("", "_red", "_green", "_blue")}
    assert scene["psnr"] == pytest.approx(np.mean([scene[f"psnr_{name}"] for name in ("red", "green", "blue")]))
    with Image.open(tmp_path / "run" / "pictures" / "coffee.png") as picture:
        assert np.ptp(np.asarray(picture.convert("RGB")).astype(int)[: picture.height // 2], axis=-1).max() > 80


def test_clips_of_a_folder_keep_their_colours(frames: np.ndarray, arrays: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "clips" / "pictures").mkdir(parents=True)
    for number, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / "clips" / "pictures" / f"{number}.png")
    np.savez(tmp_path / "clips" / "npz.npz", frames=frames)
    savemat(tmp_path / "clips" / "mat5.mat", arrays)
    write_matlab73(tmp_path / "clips" / "mat73.mat", arrays)
    clips = tmp_path / "clips"
    folder = Folder(clips, SLOTS, (SIDE, SIDE), (SIDE, SIDE), val_root=clips, store=tmp_path / "store")
    scenes = {scene.name: scene.video for scene in folder.colour_scenes()}
    assert set(scenes) == {"pictures", "npz", "mat5", "mat73"}
    for video in scenes.values():
        for group in range(2):
            expected = frames[group * SLOTS : (group + 1) * SLOTS].transpose(3, 0, 1, 2) / 255
            np.testing.assert_allclose(video[group].numpy(), expected, atol=1e-6)
    gray = Folder(clips / "npz.npz", SLOTS, (SIDE, SIDE), (SIDE, SIDE), store=tmp_path / "store").scenes()
    assert gray[0].video[0].shape == (SLOTS, SIDE, SIDE)  # its luma is another file of the store


def test_what_is_gray_or_to_be_trained_is_refused(
    refused: Callable[..., str], frames: np.ndarray, demosaicing: None, tmp_path: Path
) -> None:
    np.savez(tmp_path / "gray.npz", frames=frames[..., 0])
    savemat(tmp_path / "lab.mat", {"orig": frames[..., 0].transpose(1, 2, 0)})
    folder = ["data=folder", "data.root=gray.npz", "data.store=store"]
    assert "gray.npz, frame 0: is gray" in refused("evaluate", *EVALUATE, *folder)
    assert "data=six_scenes is gray" in refused("evaluate", *EVALUATE, "data.root=.", "data.scenes=[lab]")
    assert "both even" in refused("evaluate", *EVALUATE, "data=synthetic", "size=[32,31]")
    assert not list(tmp_path.glob("run/metrics.json"))
    small = ["scale=smoke", "decoder=e2e_cnn", "encoder=rbw_sr", "encoder/sensor=bayer", "out=trained"]
    assert "trained in gray" in refused("train", *small, "trainer.accelerator=cpu")
    assert not (tmp_path / "trained" / "checkpoints").exists()
