"""The score of a mask: what it is against whole matrices, how it ranks masks, and what noise does to it."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.mask.structure import structure
from sci_lightning.errors import BadInput
from sci_lightning.prior import MaskScore, PatchPrior, SensorNoise


def random(side: int, frames: int = 4) -> torch.Tensor:
    return torch.rand(frames, side, side, generator=torch.Generator().manual_seed(0))


def test_the_score_is_the_error_of_a_gaussian_posterior() -> None:
    """One block alone, with the whole matrix A, equal weights of pixels aside."""
    mask = (random(4) < 0.5).double()
    score = MaskScore(4, SensorNoise(bit_depth=None, read_noise=2.0))
    covariance = score.moments.matrices[0].reshape(256, 256)
    blocks = mask.repeat(1, 2, 2)
    matrix = torch.cat([torch.diag(slot.flatten()) for slot in blocks], dim=1)
    deviation = 2 / 255 * float(mask.sum(0).mean())
    spread = matrix @ covariance @ matrix.mT + deviation**2 * torch.eye(64, dtype=torch.double)
    left = covariance - covariance @ matrix.mT @ torch.linalg.solve(spread, matrix @ covariance)
    centres = torch.sin(torch.pi * (torch.arange(8) + 0.5) / 8).square()
    weights = (centres[:, None] * centres).flatten()
    weights = (weights / weights.mean()).repeat(4)
    expected = -10 * (weights * left.diagonal()).mean().log10()
    torch.testing.assert_close(score(mask), expected.double(), atol=2e-3, rtol=0)


def test_masks_are_ranked() -> None:
    """An open shutter tells nothing of the order of frames; codes do; fewer photons and more read noise cost."""
    mask = (random(8) < 0.5).double()
    score = MaskScore(4)
    assert score(mask) > score(torch.ones_like(mask)) + 1
    assert score(structure(random(8), 1)) > score(structure(random(8), 4))  # the published random masks
    assert MaskScore(4, SensorNoise(full_well=500))(mask) < score(mask) - 0.2
    assert MaskScore(4, SensorNoise(read_noise=10))(mask) < score(mask) - 0.2
    assert MaskScore(4, aperture=0.01)(mask) < score(mask) - 0.2


def test_many_masks_at_once_and_a_tile_is_its_repetition() -> None:
    score, tile = MaskScore(4), random(8)
    both = score(torch.stack([tile, tile.flip(0).roll(3, 1)]))
    torch.testing.assert_close(both[0], score(tile))
    torch.testing.assert_close(score(tile.repeat(1, 3, 3)), score(tile))
    assert score(random(200)).isfinite()  # of many blocks some are looked at


def test_what_is_refused() -> None:
    with pytest.raises(BadInput, match=r"5 slots, .* 4"):
        MaskScore(4)(random(8, frames=5))
    with pytest.raises(BadInput, match="aperture=0"):
        MaskScore(4, aperture=0)


def test_another_prior_counts() -> None:
    lags = torch.zeros(1, 4, 15, 15)
    lags[0, :, 7, 7] = 0.05  # still, and no two pixels alike
    still = MaskScore(4, prior=PatchPrior(0.5, torch.ones(1), lags))
    assert float(still(torch.ones(4, 8, 8))) > 20  # one frame of a scene at rest tells all of them


def test_pixels_that_never_open_behind_a_sensor_without_noise() -> None:
    """They measure nothing, which costs decibels and no error."""
    mask = (torch.rand(4, 16, 16) < 0.5).float()
    score = MaskScore(4, SensorNoise(bit_depth=None))
    whole = float(score(mask))
    mask[:, 3, 5] = 0
    assert whole - 1 < float(score(mask)) < whole
