"""The motion filter: what it follows, what it leaves alone, what it refuses."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch.nn.functional import interpolate

from sci_lightning.decoder import GAP, MotionFilter
from sci_lightning.decoder.denoiser import TotalVariation
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator


def moving(step: tuple[int, int], frames: int = 6, size: tuple[int, int] = (40, 48)) -> torch.Tensor:
    """``(1, T, H, W)``: a soft pattern that moves by ``step`` rows and columns from frame to frame."""
    height, width = size
    reach = frames * max(abs(each) for each in step)
    scene = interpolate(torch.rand(1, 1, 16, 16), (height + 2 * reach, width + 2 * reach), mode="bicubic")[0, 0]
    starts = [(reach - step[0] * t, reach - step[1] * t) for t in range(frames)]
    return torch.stack([scene[y : y + height, x : x + width] for y, x in starts])[None]


@pytest.mark.parametrize("step", [(0, 0), (1, 0), (-2, 3)])
def test_less_noise_along_the_motion(step: tuple[int, int]) -> None:
    video = moving(step)
    noise = 0.05 * torch.randn(video.shape)
    noisy = video + noise
    kept = noisy.clone()
    left = (MotionFilter(after=0)(noisy) - video)[..., 12:-12, 12:-12]
    assert left.square().mean() < 0.4 * noise.square().mean()  # of two to five equally noisy frames: 0.5 to 0.2
    assert torch.equal(noisy, kept)
    if step != (0, 0):
        still = (MotionFilter(after=0, reach=0)(noisy) - video)[..., 12:-12, 12:-12]
        assert left.square().mean() < 0.5 * still.square().mean()


def test_the_mean_of_what_stands_still() -> None:
    video = torch.rand(1, 1, 16, 16).expand(1, 4, 16, 16) + torch.tensor([0.0, 1e-3, 2e-3, 3e-3])[:, None, None]
    result = MotionFilter(frames=1, after=0)(video)
    torch.testing.assert_close(result[:, 0], video[:, :2].mean(1), rtol=0, atol=1e-5)
    torch.testing.assert_close(result[:, 2], video[:, 1:].mean(1), rtol=0, atol=1e-5)


def test_what_has_no_match_stays() -> None:
    video = torch.stack([level + 0.01 * torch.rand(20, 20) for level in (0.0, 0.5, 1.0)])[None]
    torch.testing.assert_close(MotionFilter(after=0)(video), video)


@pytest.mark.parametrize("shape", [(1, 1, 16, 16), (1, 2, 1, 1), (2, 3, 7, 5), (1, 9, 18, 33)])
def test_any_shape(shape: tuple[int, ...]) -> None:
    result = MotionFilter(after=0)(torch.rand(shape))
    assert result.shape == shape and bool(result.isfinite().all())
    if shape[1] == 1:
        video = torch.rand(shape)
        assert torch.equal(MotionFilter(after=0)(video), video)


def test_videos_of_a_batch_do_not_mix() -> None:
    videos = torch.cat([moving((1, 2)), moving((0, -1))]) + 0.02 * torch.randn(2, 6, 40, 48)
    together = MotionFilter(after=0)(videos)
    for alone, result in zip(videos.split(1), together.split(1), strict=True):
        torch.testing.assert_close(MotionFilter(after=0)(alone), result)


def test_when_it_searches() -> None:
    motion = MotionFilter(after=2, every=3)
    still, other = moving((0, 0)), moving((2, 1))
    assert all(torch.equal(motion(other), other) for _ in range(2))
    first = motion(still)  # finds that nothing moves ..
    assert not torch.equal(motion(other), MotionFilter(after=0)(other))  # .. and takes the next ones for still
    motion(other)
    assert torch.equal(motion(other), MotionFilter(after=0)(other))
    motion.reset()
    assert torch.equal(motion(still), still) and not torch.equal(first, still)


def test_a_decoder_without_it_and_with_it() -> None:
    """Half the error that total variation leaves, where a pattern moves; the decoder starts the search afresh."""
    video, mask = moving((0, 1), 8), (torch.rand(8, 40, 48) < 0.5).float()
    measurement = SnapshotOperator(mask)(video)
    plain, along = (GAP(TotalVariation(), [0.05], [40], motion=each) for each in (None, MotionFilter(after=10)))
    without, result = plain(measurement, mask), along(measurement, mask)
    assert (result - video).square().mean() < 0.5 * (without - video).square().mean()
    torch.testing.assert_close(along(measurement, mask), result)


@pytest.mark.parametrize(
    ("settings", "line"),
    [
        ({"frames": 0}, "frames=0: must be at least 1"),
        ({"reach": -1}, "reach=-1: must be at least 0"),
        ({"block": 6}, "block=6: must be a multiple of 4"),
        ({"block": 0}, "block=0: must be a multiple of 4"),
        ({"deviation": 0.0}, "deviation=0.0: must be positive"),
        ({"deviation": float("nan")}, "deviation=nan: must be positive"),
        ({"after": -1}, "after=-1: must be at least 0"),
        ({"every": 0}, "every=0: must be at least 1"),
    ],
)
def test_refused(settings: dict[str, Any], line: str) -> None:
    with pytest.raises(BadInput, match=f"decoder.motion.{line}"):
        MotionFilter(**settings)
