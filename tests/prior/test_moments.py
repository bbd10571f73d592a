"""Moments of a snapshot's blocks against the same formulas with whole matrices, and the grid of blocks."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.errors import BadInput
from sci_lightning.prior import BlockGrid, BlockMoments, PatchFactors, block_covariance
from sci_lightning.prior.moments import estimated_patches

SLOTS, PIXELS = 3, 4


def matrices(blocks: int = 2, components: int = 2) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Masks ``(blocks, T, n)``, the matrix A of each, and covariances ``(K, T, n, T, n)``."""
    generator = torch.Generator().manual_seed(1)
    mask = torch.rand(blocks, SLOTS, PIXELS, generator=generator)
    dense = torch.cat([torch.diag_embed(mask[:, slot]) for slot in range(SLOTS)], dim=2)
    roots = torch.randn(components, SLOTS * PIXELS, 40, generator=generator) / 6
    covariance = roots @ roots.mT
    return mask, dense, covariance.reshape(components, SLOTS, PIXELS, SLOTS, PIXELS)


def test_covariance_of_blocks() -> None:
    mask, dense, covariance = matrices()
    whole = covariance.reshape(2, 1, SLOTS * PIXELS, -1)
    torch.testing.assert_close(block_covariance(mask, covariance), dense @ whole @ dense.mT)


@pytest.mark.parametrize("slots", [SLOTS, SLOTS - 1])
def test_factored_covariance_of_blocks(slots: int) -> None:
    """All modes give the exact covariance, also through optics; with fewer modes the variances stay as they are."""
    mask, _, covariance = matrices()
    mask, covariance = mask[:, :slots], covariance[:, :slots, :, :slots]
    covariance = (covariance + covariance.flip(1, 2, 3, 4)) / 2  # as of a stationary process
    exact = block_covariance(mask, covariance)
    every = PatchFactors.of(covariance, slots * PIXELS)
    torch.testing.assert_close(every.block_covariance(mask), exact)
    optics = torch.rand(3, PIXELS, generator=torch.Generator().manual_seed(3))
    torch.testing.assert_close(every.block_covariance(mask, optics), optics @ exact @ optics.T)
    fewer = PatchFactors.of(covariance, 6)
    whole = covariance.reshape(2, slots * PIXELS, -1).diagonal(dim1=-2, dim2=-1).reshape(2, slots, PIXELS)
    kept = fewer.factors.square().sum(3).permute(2, 1, 0)
    torch.testing.assert_close(kept + fewer.rest, whole)
    left = fewer.block_covariance(mask, optics) - optics @ fewer.block_covariance(mask) @ optics.T
    assert float(left.abs().max()) < 1e-5


def test_likelihood_and_estimate_of_gaussian_patches() -> None:
    """The likelihood is torch's, and the estimate makes the error that is expected of it, on patches of the prior."""
    mask, dense, covariance = matrices()
    noise, level, number = 0.01, 0.4, 40_000
    moments = BlockMoments.of(mask, covariance, noise)
    whole = covariance.reshape(2, SLOTS * PIXELS, -1)
    generator = torch.Generator().manual_seed(2)
    patches = level + torch.randn(number, whole.shape[-1], generator=generator) @ torch.linalg.cholesky(whole[0]).mT
    measured = patches @ dense.mT + noise**0.5 * torch.randn(2, number, PIXELS, generator=generator)
    whitened, likelihood = moments.whitened(measured.transpose(0, 1), level)
    spread = dense @ whole[:, None] @ dense.mT + noise * torch.eye(PIXELS)
    mean = level * mask.sum(1)
    for component in range(2):
        for block in range(2):
            exact = torch.distributions.MultivariateNormal(mean[block], spread[component, block])
            torch.testing.assert_close(
                likelihood[component, block], exact.log_prob(measured[block]), atol=1e-3, rtol=1e-3
            )
    component = torch.zeros(2, number, dtype=torch.long)
    estimate = estimated_patches(whitened[0], mask, covariance, component, level)
    error = (estimate - patches).square().mean((1, 2))
    gain = whole[0] @ dense.mT @ spread[0].inverse() @ dense @ whole[0]
    expected = (whole[0] - gain).diagonal(dim1=-2, dim2=-1).mean(-1)
    torch.testing.assert_close(error, expected, rtol=0.02, atol=0)
    other = estimated_patches(whitened[1], mask, covariance, component + 1, level)
    assert ((other - patches).square().mean((1, 2)) > error).all()  # the wrong prior does worse


def test_noise_that_is_too_small() -> None:
    mask = torch.zeros(1, SLOTS, PIXELS)
    with pytest.raises(BadInput, match="not positive definite"):
        BlockMoments.of(mask, matrices()[2], 0.0)


@pytest.mark.parametrize(("height", "width", "stride"), [(8, 8, 4), (21, 18, 3), (5, 30, 8), (16, 24, 4)])
def test_blocks_blend_to_the_image(height: int, width: int, stride: int) -> None:
    grid = BlockGrid(height, width, 8, stride)
    image = torch.rand(2, height, width)
    padded = grid.pad(image)
    blocks = grid.cut(padded, 0, grid.rows)
    assert blocks.shape == (2, grid.rows * grid.columns, 64)
    window = grid.window()
    summed = grid.add((blocks * window).transpose(1, 2)[None], grid.rows)
    weight = grid.add(window[:, None].expand(1, 1, -1, blocks.shape[1]), grid.rows)
    torch.testing.assert_close((summed / weight)[0, :, :height, :width], image)
