"""Smooth scenes have the covariance that is stated, and patterns that are one moving mask are recognised."""

from __future__ import annotations

import math

import pytest
import torch

from sci_lightning.prior.prior import (
    BACKGROUND,
    CONTRASTS,
    DIRECTIONS,
    DURATIONS,
    FAST,
    LENGTHS,
    PatchPrior,
    fast_scene_prior,
    pattern_drift,
    smooth_scene_prior,
)

FRAMES, BLOCK = 5, 4


@pytest.mark.parametrize("drift", [(0, 0), (0, 2), (-1, 3)])
def test_covariance(drift: tuple[int, int]) -> None:
    prior = smooth_scene_prior(FRAMES, drift=drift)
    covariance = prior.covariance(FRAMES, BLOCK, floor=0.0).reshape(len(prior.weights), FRAMES, BLOCK, BLOCK, -1)
    assert len(prior.weights) == len(LENGTHS) * len(DURATIONS) * len(CONTRASTS)
    assert float(torch.linalg.eigvalsh(covariance.reshape(len(prior.weights), FRAMES * BLOCK**2, -1)).min()) > -1e-5
    # the first component, slot 3 at row 1, column 2 against slot 1 at row 3, column 0, by the formula
    distance = math.hypot(1 - 3 - drift[0] * 2, 2 - 0 - drift[1] * 2)
    alike = sum((1 + distance / length) * math.exp(-distance / length) for length in (LENGTHS[0], BACKGROUND))
    expected = CONTRASTS[0] ** 2 * math.exp(-2 / DURATIONS[0]) * alike
    there = covariance[0, 3, 1, 2].reshape(FRAMES, BLOCK, BLOCK)[1, 3, 0]
    assert float(there) == pytest.approx(expected, rel=1e-5)


def test_mixture() -> None:
    first, second = smooth_scene_prior(FRAMES), smooth_scene_prior(FRAMES, drift=(0, 1))
    both = PatchPrior.mixture([first, second])
    assert float(both.weights.sum()) == pytest.approx(1)
    assert torch.equal(both.autocovariance, torch.cat([first.autocovariance, second.autocovariance]))


@pytest.mark.parametrize("step", [(0, 2), (1, -3), (0, 0)])
def test_drift(step: tuple[int, int]) -> None:
    mask = torch.rand(40, 40, generator=torch.Generator().manual_seed(1))
    moving = torch.stack([torch.roll(mask, (slot * step[0], slot * step[1]), (0, 1)) for slot in range(FRAMES)])
    assert pattern_drift(moving) == step
    others = torch.rand(FRAMES, 40, 40, generator=torch.Generator().manual_seed(2))
    assert pattern_drift(others) == (0, 0)


def test_fast_scenes() -> None:
    """A component for every range of speeds and direction: what has moved on is alike where it went."""
    prior = fast_scene_prior(FRAMES)
    assert len(prior.weights) == len(FAST) * DIRECTIONS
    covariance = prior.covariance(FRAMES, BLOCK, floor=0.0).reshape(len(prior.weights), FRAMES * BLOCK**2, -1)
    assert float(torch.linalg.eigvalsh(covariance).min()) > -1e-5
    for component, speeds in enumerate(FAST):
        to_the_right, middle = prior.autocovariance[component * DIRECTIONS, 1], prior.reach
        row, column = divmod(int(to_the_right.argmax()), to_the_right.shape[1])
        assert row == middle and min(speeds) <= column - middle <= max(speeds)
