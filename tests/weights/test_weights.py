"""The weights that come along: small enough, with a card each, and worth what they are there for."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

import sci_lightning as sci
from sci_lightning.data import Synthetic
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import write_weights
from sci_lightning.weights import FOLDER, load_weights, shipped, weights_file

MOST_BYTES = 12e6


def test_all_together_are_small_and_each_has_a_card() -> None:
    assert shipped() == ["lsw_sr", "pnp_fastdvdnet", "pnp_ffdnet", "universal"]
    assert sum(weights_file(name).stat().st_size for name in shipped()) <= MOST_BYTES
    for name in shipped():
        card = (FOLDER / f"{name}.md").read_text()
        for heading in ("## Data and licences", "## Training", "## Scores", "## Limits"):
            assert heading in card, (name, heading)


@pytest.mark.parametrize("name", shipped())
def test_every_file_is_a_checkpoint(name: str) -> None:
    checkpoint = load_weights(name)
    assert checkpoint.decoder().training is False
    assert torch.isfinite(checkpoint.encoder().mask()).all()


@torch.no_grad()
@pytest.mark.parametrize("mask", [sci.masks.RandomBinary(8, (64, 64), seed=7), sci.masks.Shifting(8, (64, 64), seed=7)])
def test_universal_is_ahead_of_its_start_behind_masks_that_it_has_not_seen(mask: sci.masks.Mask) -> None:
    video = torch.stack([scene.video[0] for scene in Synthetic(8, (64, 64), (64, 64), scenes_count=2).scenes()])
    decoder = sci.load_decoder("universal")
    measurement = sci.Encoder(mask, sci.sensors.Ideal())(video)
    before, after = decoder.start(measurement, mask()), decoder(measurement, mask())
    assert (sci.metrics.psnr(after, video) - sci.metrics.psnr(before, video)).mean() > 0.3


@torch.no_grad()
def test_the_camera_is_ahead_of_a_decoder_for_any_mask_behind_its_own() -> None:
    video = torch.stack([scene.video[0] for scene in Synthetic(8, (64, 64), (64, 64), scenes_count=2).scenes()])
    camera = load_weights("lsw_sr")
    mask = camera.encoder().mask()[:, :64, :64]
    measurement = (mask * video).sum(1)
    scores = [sci.metrics.psnr(d(measurement, mask), video) for d in (sci.load_decoder("gap_tv"), camera.decoder())]
    assert (scores[1] - scores[0]).mean() > 1


@torch.no_grad()
@pytest.mark.parametrize("name", ["pnp_ffdnet", "pnp_fastdvdnet"])
def test_denoisers_take_noise_away(name: str) -> None:
    """Twice as close to the video as it was where the strength is that of the noise, whatever else is set."""
    video = torch.stack([scene.video[0] for scene in Synthetic(8, (64, 64), (64, 64), scenes_count=2).scenes()])
    noisy = video + 0.05 * torch.randn(video.shape, generator=torch.Generator().manual_seed(0))
    clean = sci.load_decoder(name, ["decoder.iterations=[3]"]).denoiser(noisy, 0.05)
    assert (clean - video).square().mean().sqrt() < 0.025


def test_evaluate_builds_the_mask_that_is_asked_for(
    command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    words = ["decoder=universal", "encoder=rbw_sr", "encoder.aperture=1/T", "data=synthetic", "metric=[psnr]"]
    done = command("evaluate", *words, "size=[32,32]", "data.scenes_count=1", "pictures=0", "out=e")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "e" / "metrics.json").exists()


def test_weights_that_are_no_numbers(tmp_path: Path) -> None:
    weights = load_weights("universal")
    broken = {key: value * torch.nan if key == "decoder.step" else value for key, value in weights.state.items()}
    write_weights(tmp_path / "nan.safetensors", weights.config, broken)
    with pytest.raises(BadInput, match=r"nan\.safetensors: 'decoder\.step' holds NaN"):
        load_weights(tmp_path / "nan.safetensors").decoder()


def test_names() -> None:
    with pytest.raises(BadInput, match=r"weights=best: no such file.*universal"):
        load_weights("best")
    assert load_weights(weights_file("universal")).config["names"]["decoder"] == "universal"


def test_reconstruct_takes_them_where_nothing_else_is_named(
    command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    mask = sci.masks.RandomBinary(8, (32, 32), seed=3)()
    np.save(tmp_path / "mask.npy", mask.numpy())
    np.save(tmp_path / "snapshot.npy", (mask.mean(0) * 200).byte().numpy())
    files = ["measurement=snapshot.npy", "mask=mask.npy"]
    done = command("reconstruct", *files, "out=r")
    assert done.returncode == 0, done.stderr
    assert "weights=universal" in done.stdout
    assert np.load(tmp_path / "r" / "reconstruction.npy").shape == (1, 8, 32, 32)
    refused = command("reconstruct", files[0], "out=s")
    assert refused.returncode and "mask=FILE" in refused.stderr
    twice = command("reconstruct", *files, "weights=universal", "ckpt_path=snapshot.npy", "out=t")
    assert twice.returncode and "give one of them" in twice.stderr
