"""PSNR and SSIM against scikit-image, frame by frame."""

from __future__ import annotations

import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from sci_lightning.errors import BadInput
from sci_lightning.metrics import PSNR, SSIM, psnr, ssim
from sci_lightning.metrics.scene_scores import SceneScores


def videos(height: int = 40, width: int = 56) -> tuple[torch.Tensor, torch.Tensor]:
    truth = torch.nn.functional.interpolate(torch.rand(2, 3, height // 8, width // 8), (height, width), mode="bilinear")
    return truth + 0.1 * torch.randn_like(truth), truth  # leaves [0, 1]: nothing is clipped


def test_against_scikit_image() -> None:
    estimate, truth = videos()
    settings = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 1.0}
    for x, y, p, s in zip(
        *(v.flatten(0, 1) for v in (estimate, truth)),
        psnr(estimate, truth).flatten(),
        ssim(estimate, truth).flatten(),
        strict=True,
    ):
        x, y = x.double().numpy(), y.double().numpy()
        assert float(p) == pytest.approx(peak_signal_noise_ratio(y, x, data_range=1.0), abs=1e-6)
        assert float(s) == pytest.approx(structural_similarity(y, x, **settings), abs=1e-6)


def test_no_error_at_all() -> None:
    truth = torch.rand(4, 16, 16)
    assert psnr(truth, truth).tolist() == [100.0] * 4
    assert ssim(truth, truth).tolist() == pytest.approx([1.0] * 4)


@pytest.mark.parametrize(("metric", "function"), [(PSNR, psnr), (SSIM, ssim)])
def test_metric_is_the_mean_over_frames(metric: type, function: object) -> None:
    estimate, truth = videos()
    together = metric()
    together.update(estimate[:1], truth[:1])
    together.update(estimate[1], truth[1])
    assert float(together.compute()) == pytest.approx(float(function(estimate, truth).mean()))  # type: ignore[operator]


def test_ssim_needs_its_window() -> None:
    with pytest.raises(BadInput, match="11 x 11"):
        ssim(torch.rand(10, 20), torch.rand(10, 20))


def test_scenes_count_alike_whatever_their_length() -> None:
    scores = SceneScores(["long", "short"])
    estimate, truth = videos()
    scores.update(0, estimate, truth)
    scores.update(1, estimate[0], estimate[0])
    scenes, mean = scores.compute()
    assert scenes["short"] == {"psnr": 100.0, "ssim": pytest.approx(1.0)}
    assert mean["psnr"] == pytest.approx((scenes["long"]["psnr"] + 100) / 2)
