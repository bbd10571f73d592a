"""Total variation, against scikit-image frame by frame."""

from __future__ import annotations

import pytest
import torch
from skimage.restoration import denoise_tv_chambolle

from sci_lightning.decoder.denoiser import TotalVariation
from sci_lightning.errors import BadInput


@pytest.mark.parametrize("shape", [(2, 3, 32, 32), (1, 2, 17, 24)])
@pytest.mark.parametrize("steps", [1, 5, 40])
@pytest.mark.parametrize("strength", [0.02, 0.1, 2.0])
def test_against_scikit_image(shape: tuple[int, ...], steps: int, strength: float) -> None:
    video = torch.rand(shape)
    found = TotalVariation(steps)(video, strength)
    for clip, denoised in zip(video, found, strict=True):
        for frame, ours in zip(clip, denoised, strict=True):
            theirs = denoise_tv_chambolle(frame.double().numpy(), strength, eps=0, max_num_iter=steps + 1)
            torch.testing.assert_close(ours.double(), torch.from_numpy(theirs), rtol=0, atol=1e-5)


@pytest.mark.parametrize("steps", [1, 5, 40])
@pytest.mark.parametrize("strength", [0.02, 0.1, 2.0])
def test_over_time_against_scikit_image(steps: int, strength: float) -> None:
    video = torch.rand(2, 5, 17, 24)
    found = TotalVariation(steps, temporal=1)(video, strength)
    for clip, denoised in zip(video, found, strict=True):
        theirs = denoise_tv_chambolle(clip.double().numpy(), strength, eps=0, max_num_iter=steps + 1)
        torch.testing.assert_close(denoised.double(), torch.from_numpy(theirs), rtol=0, atol=1e-5)


def test_the_weight_of_time() -> None:
    """Between frame by frame and a dimension like the others; at its minimum whatever it is."""
    video = torch.rand(1, 4, 12, 12)

    def objective(z: torch.Tensor, weight: float) -> float:
        squares = torch.zeros_like(z)
        for axis, each in ((-1, 1.0), (-2, 1.0), (-3, weight)):
            last = z.narrow(axis, z.shape[axis] - 1, 1)
            squares += (each * z.diff(dim=axis, append=last)).square()
        return float((z - video).square().sum() / 2 + 0.1 * squares.sqrt().sum())

    found = {weight: TotalVariation(300, weight)(video, 0.1) for weight in (0.0, 0.3, 1.0)}
    for weight, best in found.items():
        assert all(objective(best, weight) <= objective(other, weight) for other in found.values())
        assert objective(best, weight) <= objective(best + 0.01 * torch.randn(best.shape), weight)


def test_what_it_keeps() -> None:
    edge = torch.zeros(1, 1, 16, 16)
    edge[..., 8:] = 1
    assert torch.equal(TotalVariation()(torch.full((1, 2, 8, 8), 0.5), 0.1), torch.full((1, 2, 8, 8), 0.5))
    noisy = edge + 0.1 * torch.randn(edge.shape)
    kept = noisy.clone()
    assert (TotalVariation(50)(noisy, 0.2) - edge).square().mean() < 0.2 * (noisy - edge).square().mean()
    assert torch.equal(noisy, kept)  # in place, but not in the caller's


def test_no_steps() -> None:
    with pytest.raises(BadInput, match=r"decoder.denoiser.steps=0: must be at least 1"):
        TotalVariation(0)
    for weight in (-0.1, 1.1, torch.nan):
        with pytest.raises(BadInput, match=r"decoder.denoiser.temporal=.*: must lie between 0"):
            TotalVariation(5, weight)
