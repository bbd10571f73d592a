"""The linear decoder: better than what it starts from, the same in strips and tiles, and computed once per mask."""

from __future__ import annotations

import pytest
import torch
from torch.nn.functional import interpolate

from sci_lightning.decoder import Linear
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator
from sci_lightning.prior import BlockMoments, estimator
from sci_lightning.prior.estimator import distinct_blocks


def smooth_scene(frames: int = 4, number: int = 2, side: int = 32) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return interpolate(torch.rand(number, frames, 4, 4, generator=generator), (side, side), mode="bicubic").clamp(0, 1)


def random_mask(frames: int = 4, side: int = 32) -> torch.Tensor:
    return torch.rand(frames, side, side, generator=torch.Generator().manual_seed(1))


def error(estimate: torch.Tensor, video: torch.Tensor) -> float:
    return float((estimate - video).square().mean())


@pytest.mark.parametrize("gray", [False, True])
def test_better_than_the_mean_frame(gray: bool) -> None:
    video, mask = smooth_scene(), random_mask()
    mask = mask / mask.sum(0) if gray else (mask < 0.5).float()
    measurement = SnapshotOperator(mask)(video)
    estimate = Linear()(measurement, mask)
    assert error(estimate, video) < 0.3 * error(SnapshotOperator(mask).mean_video(measurement), video)
    assert error(SnapshotOperator(mask)(estimate), measurement) < 0.02**2


@pytest.mark.parametrize("mixture", [False, True])
def test_strips_and_kinds_change_nothing(monkeypatch: pytest.MonkeyPatch, mixture: bool) -> None:
    video, mask = smooth_scene(), (random_mask(side=8) < 0.5).float().repeat(1, 4, 4)
    measurement = SnapshotOperator(mask)(video)
    expected = Linear(mixture=mixture)(measurement, mask)
    for name, value in (("FEW_KINDS", 0), ("STRIP", 1), ("MEMORY", 0)):
        monkeypatch.setattr(estimator, name, value)
        torch.testing.assert_close(Linear(mixture=mixture)(measurement, mask), expected, atol=1e-4, rtol=0)


def test_a_tile_costs_its_distinct_blocks_and_a_mask_is_prepared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    prepared = []
    original = BlockMoments.of
    monkeypatch.setattr(BlockMoments, "of", lambda mask, *more: (prepared.append(len(mask)), original(mask, *more))[1])
    decoder, tiled, free = Linear(), random_mask(side=8).repeat(1, 4, 4), random_mask()
    measurement = torch.rand(1, 32, 32)
    for mask in (tiled, tiled, free, tiled, free):
        decoder(measurement, mask)
    assert prepared == [4, 49]
    decoder(measurement, free + 0.001)
    assert prepared == [4, 49, 49]


def test_a_block_has_the_matrix_of_its_likeliest_component_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what was computed for one measurement is there for the next one."""
    computed = []
    original = BlockMoments.of

    def counted(mask: torch.Tensor, covariance: torch.Tensor, noise: float) -> BlockMoments:
        computed.append(len(mask) * len(covariance))
        return original(mask, covariance, noise)

    monkeypatch.setattr(BlockMoments, "of", counted)
    mask = random_mask(side=40)
    measurements = SnapshotOperator(mask)(smooth_scene(side=40))  # of noise alone the estimates are tens, not of 0 to 1
    components = len(Linear().estimator.prior.weights)
    sparing = Linear()
    one = sparing(measurements[:1], mask)
    assert sum(computed) == 25 * components + 81  # of 81 blocks 25 do not overlap, and tell the components apart
    both = sparing(measurements, mask)
    torch.testing.assert_close(both[:1], one)
    assert sum(computed) <= 25 * components + 2 * 81
    spent = len(computed)
    sparing(measurements, mask)
    assert len(computed) == spent
    monkeypatch.setattr(estimator, "FEW_KINDS", 81)
    torch.testing.assert_close(Linear()(measurements, mask), both, atol=1e-4, rtol=0)


def test_the_memory_for_prepared_masks_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    decoder = Linear(mixture=False)
    for number in range(5):
        decoder(torch.rand(1, 32, 32), random_mask() * (1 - 0.1 * number))
    one = decoder.estimator._kept[0].size()
    assert len(decoder.estimator._kept) == 5
    monkeypatch.setattr(estimator, "MEMORY", 2 * one)
    decoder(torch.rand(1, 32, 32), random_mask() / 2)
    assert len(decoder.estimator._kept) == 2


def test_gradients_reach_mask_and_measurement() -> None:
    decoder = Linear(mixture=False)
    mask = random_mask(side=16).requires_grad_()
    measurement = torch.rand(1, 16, 16, requires_grad=True)
    decoder(measurement, mask).square().mean().backward()
    assert mask.grad is not None and mask.grad.abs().sum() > 0
    assert measurement.grad is not None and measurement.grad.abs().sum() > 0


def test_prepared_in_a_test_used_in_a_training() -> None:
    decoder, mask = Linear(mixture=False), random_mask(side=16)
    with torch.inference_mode():
        decoder(torch.rand(1, 16, 16), mask.clone())
    decoder(torch.rand(1, 16, 16, requires_grad=True), mask).sum().backward()


def test_low_precision_around_it_does_not_matter() -> None:
    decoder, mask, measurement = Linear(), random_mask(), torch.rand(1, 32, 32)
    expected = decoder(measurement, mask)
    with torch.autocast("cpu", torch.bfloat16):
        torch.testing.assert_close(decoder(measurement, mask), expected)
    rounded = decoder.bfloat16()(measurement.bfloat16(), mask.bfloat16())
    assert rounded.dtype == torch.bfloat16 and (rounded.float() - expected).abs().max() < 0.2


def test_distinct_blocks() -> None:
    blocks = torch.rand(3, 2, 4)[[2, 0, 2, 1, 0]]
    examples, kind = distinct_blocks(blocks)
    assert torch.equal(blocks[examples][kind], blocks) and len(examples) == 3
    examples, kind = distinct_blocks(torch.rand(5, 2, 4))
    assert torch.equal(examples, torch.arange(5)) and torch.equal(kind, examples)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"noise": 0}, "noise=0: must be positive"),
        ({"stride": 9}, "stride=9: must be from 1"),
        ({"block": 64}, "block=64: the patch statistics reach over"),
        ({"prior": "none.npz"}, "no such file"),
    ],
)
def test_settings_that_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        Linear(**settings)  # type: ignore[arg-type]


def test_it_says_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where its matrices do not fit into memory and are computed strip by strip."""
    for memory in (2**31, 0):
        monkeypatch.setattr(estimator, "MEMORY", memory)
        monkeypatch.setattr(estimator, "STRIP", 2**14)
        decoder, said = Linear(), []
        decoder.watch = said.append
        decoder(torch.rand(1, 40, 40), torch.rand(4, 40, 40))
        assert sum("strip, part" in words for words in said) > 1
        assert any(("matrices, part" if memory else "component") in words for words in said)
