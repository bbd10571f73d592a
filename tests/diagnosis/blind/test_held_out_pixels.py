"""Held-out pixels are spread evenly, disjoint and seeded; what fills them in does not look at them."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.diagnosis.blind.held_out_pixels import blue_noise_folds, fill_in
from sci_lightning.errors import BadInput


def test_folds_are_disjoint_and_blue() -> None:
    folds = blue_noise_folds((96, 80), share=0.05, folds=4, seed=1)
    assert folds.shape == (4, 96, 80) and int(folds.sum(0).max()) == 1
    for fold in folds:
        assert abs(float(fold.float().mean()) - 0.05) < 0.004
        # white noise of this density has a neighbour within one pixel for a third of its pixels
        near = torch.nn.functional.max_pool2d(_others(fold), 3, 1, 1)[0]
        assert float(near[fold].mean()) < 0.02
        by_block = fold.float().unfold(0, 16, 16).unfold(1, 16, 16).sum((-2, -1))
        assert by_block.var() < 0.5 * by_block.mean()  # 1.0 for white noise
    assert not torch.equal(folds, blue_noise_folds((96, 80), seed=2))
    assert torch.equal(folds, blue_noise_folds((96, 80), seed=1))


def _others(fold: torch.Tensor) -> torch.Tensor:
    """For every pixel, whether one of its eight neighbours is held out: the pixel itself does not count."""
    kernel = torch.ones(1, 1, 3, 3)
    kernel[..., 1, 1] = 0
    neighbours = torch.nn.functional.conv2d(fold.float()[None, None], kernel, padding=1)[0]
    return torch.where(fold, neighbours, torch.zeros_like(neighbours)).clamp(max=1)


def test_more_folds_than_pixels_are_refused() -> None:
    with pytest.raises(BadInput, match="at most all pixels"):
        blue_noise_folds((32, 32), share=0.05, folds=21)


def test_filling_in() -> None:
    images = torch.linspace(0, 1, 20)[None, :, None].expand(2, 20, 20).contiguous()
    known = torch.rand(20, 20, generator=torch.Generator().manual_seed(0)) > 0.2
    filled = fill_in(torch.where(known, images, torch.full_like(images, 99.0)), known)
    assert torch.equal(filled[:, known], images[:, known])
    assert (filled - images).abs().max() < 0.06
    assert not fill_in(images, torch.zeros(20, 20, dtype=torch.bool)).any()
