"""Weighted nuclear norm minimisation: the shrinkage against its definition, the search against a plain one."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch.nn.functional import interpolate

from sci_lightning.decoder.denoiser import WNNM
from sci_lightning.errors import BadInput


def test_the_shrinkage_solves_its_equation() -> None:
    """Every singular value kept is s' = s - C / s', the least s of those is 2 sqrt(C), the singular vectors stay."""
    denoiser, strength = WNNM(patch=6, step=6, reach=0, neighbours=12, weight=0.5), 0.1
    video = torch.rand(3, 12, 6, 6, dtype=torch.float64)  # whose only group has all frames
    stack = video.flatten(2)
    mean = stack.mean(1, keepdim=True)
    before, after = stack - mean, denoiser(video, strength).flatten(2) - mean
    c = 2 * 0.5 * 12**0.5 * strength**2
    for one, other in zip(before, after, strict=True):
        left, s, right = torch.linalg.svd(one, full_matrices=False)
        shrunk = torch.diagonal(left.T @ other @ right.T)
        torch.testing.assert_close(left @ shrunk.diag() @ right, other)
        kept = s > 2 * c**0.5
        assert 0 < kept.sum() < len(s)
        torch.testing.assert_close(shrunk[kept], s[kept] - c / shrunk[kept])
        assert shrunk[~kept].abs().max() < 1e-9


def test_the_nearest_patches_are_found() -> None:
    """So strong that every patch becomes the mean of its group, which the pixels under several patches average."""
    frames = torch.rand(3, 9, 11, dtype=torch.float64)
    places = [(t, y, x) for t in range(3) for y in range(7) for x in range(9)]
    patches = torch.stack([frames[t, y : y + 3, x : x + 3].flatten() for t, y, x in places])
    total, count = torch.zeros(2, *frames.shape, dtype=torch.float64)
    for t, top, left in [(t, y, x) for t in range(3) for y in range(0, 7, 2) for x in range(0, 9, 2)]:
        near = [n for n, (_, y, x) in enumerate(places) if abs(y - top) <= 2 and abs(x - left) <= 2]
        distance = (patches[near] - patches[places.index((t, top, left))]).square().sum(1)
        group = [near[n] for n in distance.argsort()[:5].tolist()]
        for number, y, x in (places[n] for n in group):
            total[number, y : y + 3, x : x + 3] += patches[group].mean(0).view(3, 3)
            count[number, y : y + 3, x : x + 3] += 1
    denoised = WNNM(patch=3, step=2, reach=2, neighbours=5)(frames[None], strength=100.0)[0]
    torch.testing.assert_close(denoised, total / count)


def test_noise_goes() -> None:
    clean = interpolate(torch.rand(1, 4, 4, 4), (30, 33), mode="bilinear")
    noisy = clean + 0.1 * torch.randn(clean.shape)
    result = WNNM()(noisy, 0.1)
    assert result.shape == clean.shape
    assert (result - clean).square().mean() < 0.3 * (noisy - clean).square().mean()
    still = torch.full((1, 2, 12, 12), 0.5)
    torch.testing.assert_close(WNNM()(still, 0.1), still)


@pytest.mark.parametrize("shape", [(1, 1, 3, 5), (2, 2, 8, 8), (1, 3, 9, 20)])
def test_small_frames(shape: tuple[int, ...]) -> None:
    """Frames below the patch's side, and with fewer patches than a group has."""
    video = torch.rand(shape)
    result = WNNM(reach=1, neighbours=40)(video, 0.05)
    assert result.shape == video.shape and torch.isfinite(result).all()
    assert result.min() > -0.5 and result.max() < 1.5


def test_a_search_serves_for_several_calls() -> None:
    video, other = torch.rand(2, 1, 3, 12, 12)
    denoiser = WNNM(patch=4, step=2, every=2, neighbours=4)
    denoiser(video, 0.1)
    second = denoiser(other, 0.1)
    third = denoiser(other, 0.1)
    assert not torch.equal(second, third)  # of groups of the first video's patches, and of its own
    denoiser.reset()
    assert torch.equal(denoiser(other, 0.1), third)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"patch": 0}, "decoder.denoiser.patch=0: must be at least 1"),
        ({"neighbours": 0}, "decoder.denoiser.neighbours=0: must be at least 1"),
        ({"every": 0}, "decoder.denoiser.every=0: must be at least 1"),
        ({"reach": -1}, "decoder.denoiser.reach=-1: must be at least 0"),
        ({"patch": 4, "step": 5}, "decoder.denoiser.step=5: must be at most patch=4"),
        ({"weight": 0}, "decoder.denoiser.weight=0: must be positive"),
    ],
)
def test_settings_that_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        WNNM(**settings)
