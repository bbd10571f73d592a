"""PSNR and SSIM against scikit-image, frame by frame; what metrics of frames and scores of scenes have in common."""

from __future__ import annotations

import math
import pickle
from collections.abc import Sequence
from copy import deepcopy

import pytest
import torch
from skimage.data import camera
from skimage.metrics import peak_signal_noise_ratio, structural_similarity
from torchmetrics.functional.image import structural_similarity_index_measure

from sci_lightning.errors import BadInput
from sci_lightning.metrics import HDRVDP2, PSNR, SSIM, hdrvdp2_q, psnr, ssim
from sci_lightning.metrics.frame_metric import FrameMetric, SceneScores


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


def test_torchmetrics_has_other_values() -> None:
    """On a photograph torchmetrics differs from scikit-image; the docstring of :func:`ssim` says by how much."""
    truth = torch.from_numpy(camera()[:256, :256] / 255)
    estimate = truth + 0.05 * torch.randn(truth.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    theirs = structural_similarity_index_measure(estimate[None, None], truth[None, None], data_range=1.0)
    assert 5e-4 < abs(float(ssim(estimate, truth)) - float(theirs)) < 5e-3


def test_no_error_at_all() -> None:
    truth = torch.rand(4, 16, 16)
    assert psnr(truth, truth).tolist() == [100.0] * 4
    assert psnr(truth + 1e-7, truth).tolist() == [100.0] * 4  # an error does not score better than none
    assert ssim(truth, truth).tolist() == pytest.approx([1.0] * 4)


def q(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    return hdrvdp2_q(estimate.flatten(0, 1).clamp(min=0), truth.flatten(0, 1))


METRICS = [(PSNR(), psnr), (SSIM(), ssim), (HDRVDP2(clip_negative=True), q)]


@pytest.mark.parametrize(("metric", "function"), METRICS)
def test_metric_is_the_mean_over_frames(metric: FrameMetric, function: object) -> None:
    estimate, truth = videos()
    together = deepcopy(metric)
    together.update(estimate[:1], truth[:1])
    together.update(estimate[1], truth[1])
    assert float(together.compute()) == pytest.approx(float(function(estimate, truth).mean()))  # type: ignore[operator]
    restored = pickle.loads(pickle.dumps(together))
    assert float(restored.compute()) == float(together.compute())
    together.plot()
    together.reset()
    assert float(together(estimate, truth)) == pytest.approx(float(restored.compute()))


@pytest.mark.parametrize("metric", [metric for metric, _ in METRICS])
def test_estimate_and_truth_have_one_shape(metric: FrameMetric) -> None:
    with pytest.raises(BadInput, match="one shape"):
        deepcopy(metric).update(torch.rand(2, 1, 20, 20), torch.rand(2, 3, 20, 20))


def test_ssim_needs_its_window() -> None:
    with pytest.raises(BadInput, match="11 x 11"):
        ssim(torch.rand(10, 20), torch.rand(10, 20))


def test_scenes_count_alike_whatever_their_length() -> None:
    scores = SceneScores(["long", "short"], {"psnr": PSNR(), "ssim": SSIM(), "qscore": HDRVDP2(clip_negative=True)})
    estimate, truth = videos()
    scores.update(0, estimate, truth)
    scores.update(1, truth[0], truth[0])
    scenes, mean = scores.compute()
    assert scenes["short"] == {"psnr": 100.0, "ssim": pytest.approx(1.0), "qscore": 100.0}
    assert mean["psnr"] == pytest.approx((scenes["long"]["psnr"] + 100) / 2)


def test_scenes_that_were_not_seen_are_left_out() -> None:
    scores = SceneScores(["seen", "broken", "unseen"], {"psnr": PSNR()})
    estimate, truth = videos()
    scores.update(0, estimate, truth)
    assert scores.compute() == ({"seen": {"psnr": (mean := float(psnr(estimate, truth).mean()))}}, {"psnr": mean})
    scores.update(1, estimate * torch.nan, truth)  # is not the same as unseen
    scenes, nothing = scores.compute()
    assert list(scenes) == ["seen", "broken"] and math.isnan(nothing["psnr"])


def test_metrics_that_agree_at_first_stay_apart() -> None:
    """PSNR and Q of a perfect first snapshot are both 100."""
    scores = SceneScores(["scene"], {"psnr": PSNR(), "qscore": HDRVDP2(clip_negative=True)})
    estimate, truth = videos()
    scores.update(0, truth, truth)
    scores.update(0, estimate, truth)
    _, mean = scores.compute()
    assert mean["qscore"] == pytest.approx((100 + float(q(estimate, truth).mean())) / 2)
    assert mean["psnr"] == pytest.approx((100 + float(psnr(estimate, truth).mean())) / 2)


@pytest.mark.parametrize(("every", "seen"), [(1, range(8)), (2, [1, 3, 5, 7]), (3, [1, 4, 7]), (8, [4]), (20, [4])])
def test_one_frame_in_so_many(every: int, seen: Sequence[int]) -> None:
    truth = torch.rand(8, 20, 20)
    estimate = truth + torch.linspace(0.1, 0.5, 8)[:, None, None] * torch.randn_like(truth)
    scores = SceneScores(["scene"], {"ssim": SSIM(), "psnr": PSNR()}, {"psnr": every, "absent": 3})
    scores.update(0, estimate, truth)
    _, mean = scores.compute()
    assert mean["psnr"] == pytest.approx(float(psnr(estimate, truth)[list(seen)].mean()))
    assert mean["ssim"] == pytest.approx(float(ssim(estimate, truth).mean()))
