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
    result = TotalVariation(steps)(video, strength)
    for clip, denoised in zip(video, result, strict=True):
        for frame, ours in zip(clip, denoised, strict=True):
            theirs = denoise_tv_chambolle(frame.double().numpy(), strength, eps=0, max_num_iter=steps + 1)
            torch.testing.assert_close(ours.double(), torch.from_numpy(theirs), rtol=0, atol=1e-5)


def test_at_the_minimum() -> None:
    """Slopes to the next row and column count together; beyond the last one there is none."""
    video = torch.rand(1, 2, 12, 12)

    def objective(z: torch.Tensor) -> float:
        rows, columns = z.diff(dim=-2, append=z[..., -1:, :]), z.diff(dim=-1, append=z[..., -1:])
        return float((z - video).square().sum() / 2 + 0.1 * (rows.square() + columns.square()).sqrt().sum())

    best = TotalVariation(300)(video, 0.1)
    assert objective(best) < objective(TotalVariation(3)(video, 0.1)) < objective(video)
    assert all(objective(best) <= objective(best + 0.01 * torch.randn(best.shape)) for _ in range(10))


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
