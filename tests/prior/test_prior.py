"""The patch prior: what its covariance is, how it is read and written, and that fitting finds what made the clips."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.errors import BadInput
from sci_lightning.prior import PatchPrior
from sci_lightning.prior.fit import fit_prior
from sci_lightning.prior.prior import SHIPPED, read_prior


def test_the_covariance_is_stationary_and_the_same_for_every_number_of_frames() -> None:
    prior = read_prior().merged()
    long, short = prior.covariance(8, 6), prior.covariance(4, 6)
    torch.testing.assert_close(long[:, :4, :, :4], short, atol=2e-3, rtol=0)
    torch.testing.assert_close(long, long.permute(0, 3, 4, 1, 2))
    field = long.reshape(8, 6, 6, 8, 6, 6)
    torch.testing.assert_close(field[1, 2, 3, 4, 5, 5], field[2, 0, 1, 5, 3, 3], atol=2e-3, rtol=0)
    assert torch.linalg.eigvalsh(long.reshape(288, 288)).min() > 0


def test_shipped_statistics() -> None:
    """They are small, describe video (neighbours alike, frames less so with their distance) and reach 16 frames."""
    prior = read_prior()
    assert SHIPPED.stat().st_size < 2**20
    assert prior.autocovariance.shape[1] >= 16 and prior.reach >= 7
    assert 0.3 < prior.level < 0.7
    middle = prior.reach
    in_time = prior.merged().autocovariance[0, :, middle, middle]
    assert (in_time.diff() < 0).all() and in_time[-1] > 0.4 * in_time[0]
    beside = prior.merged().autocovariance[0, 0, middle, middle + 1]
    assert 0.95 < float(beside / in_time[0]) < 1


def test_more_frames_than_the_statistics_reach() -> None:
    prior = read_prior().merged()
    variance = prior.covariance(24, 4)[0].reshape(24 * 16, 24 * 16)
    first = variance[0, ::16]
    assert torch.linalg.eigvalsh(variance).min() > 0
    assert (first[1:] < first[:-1] + 1e-3).all()
    with pytest.raises(BadInput, match="choose a smaller block"):
        prior.covariance(4096, 4)
    with pytest.raises(BadInput, match="reach over"):
        prior.covariance(4, 64)


def test_fitting_recovers_the_process(tmp_path: Path) -> None:
    """Clips of white noise that is blurred across by one pixel have the covariance of that blur."""
    noise = torch.randn(24, 48, 49, generator=torch.Generator().manual_seed(0))
    clip = 0.5 + 0.1 * (noise[..., 1:] + noise[..., :-1]) / 2**0.5
    lines: list[str] = []
    prior = fit_prior([clip], components=2, patches=400, iterations=2, on_progress=lines.append)
    assert len(lines) == 2
    merged = prior.merged().autocovariance[0]
    middle = prior.reach
    torch.testing.assert_close(float(merged[0, middle, middle]), 0.01, rtol=0.05, atol=0)
    torch.testing.assert_close(float(merged[0, middle, middle + 1]), 0.005, rtol=0.1, atol=0)
    assert abs(float(merged[0, middle + 1, middle])) < 5e-4 and abs(float(merged[1, middle, middle])) < 5e-4
    prior.save(tmp_path / "mine.npz")
    again = read_prior(tmp_path / "mine.npz")
    torch.testing.assert_close(again.autocovariance, prior.autocovariance)
    assert again.level == prior.level


def test_files_that_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no such file"):
        read_prior(tmp_path / "none.npz")
    for name, content in {
        "keys": {"level": 0.5},
        "shape": {"level": 0.5, "weights": np.ones(2), "autocovariance": np.ones((1, 4, 3, 3))},
        "nan": {"level": 0.5, "weights": np.ones(1), "autocovariance": np.full((1, 4, 3, 3), np.nan)},
    }.items():
        np.savez(tmp_path / f"{name}.npz", **content)
        with pytest.raises(BadInput, match=f"{name}.npz"):
            read_prior(tmp_path / f"{name}.npz")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(BadInput, match="not patch statistics"):
        read_prior(tmp_path / "text.npz")


def test_clips_that_are_too_small() -> None:
    with pytest.raises(BadInput, match="no clips"):
        fit_prior([])
    with pytest.raises(BadInput, match=r"clip 0 is \(8, 20, 20\)"):
        fit_prior([torch.zeros(8, 20, 20)])


def test_merged_is_the_mixture_covariance() -> None:
    prior = PatchPrior(0.5, torch.tensor([0.25, 0.75]), torch.rand(2, 3, 5, 5))
    torch.testing.assert_close(
        prior.merged().autocovariance[0],
        (prior.autocovariance * torch.tensor([0.25, 0.75])[:, None, None, None]).sum(0),
    )
