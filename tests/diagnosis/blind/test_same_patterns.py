"""What two candidates do to the patterns says whether snapshots behind them can tell one from the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.blind.same_patterns import SamePatterns
from tests.diagnosis.blind.conftest import snapshots
from tests.diagnosis.blind.smooth_scenes import likelihood_of

NAMES = (
    "pattern_order",
    "mask_orientation",
    "mask_level_gamma",
    "mask_contrast",
    "mask_lag",
    "sync_offset",
    "mask_shift",
    "mask_rotation",
    "mask_scale",
    "mask_blur",
    "mask_distortion",
    "black_level",
)


def of(captures: Captures) -> SamePatterns:
    likelihood, ideal = likelihood_of(captures)
    return SamePatterns(likelihood, ideal, NAMES)


def moving(frames: int, step: int, side: int = 64) -> Captures:
    """Return snapshots, without any meaning, behind one gray mask that moves to the right from slot to slot."""
    captures = snapshots(frames=frames, side=side)
    mask = np.random.default_rng(3).uniform(0, 1, (side, side + step * frames)).astype(np.float32)
    patterns = np.stack([mask[:, step * (frames - slot) :][:, :side] for slot in range(frames)])
    return replace(captures, patterns=patterns)


def test_independent_patterns() -> None:
    """A lag and a delay are the same, and a curve of the levels does nothing to two of them."""
    same = of(snapshots(frames=8, side=64))
    assert same.idle == {"mask_level_gamma"} and not any(same.replaced.values())
    assert same.continuous("mask_lag") == ["sync_offset"] and same.continuous("sync_offset") == ["mask_lag"]
    assert {name for name, others in same.same.items() if others} == {"mask_lag", "sync_offset"}


def test_behind_a_mask_that_moves_an_order_is_a_displacement() -> None:
    same = of(moving(frames=16, step=2))
    assert same.replaced["pattern_order"] == [{"offset": -1}, {"offset": 1}] and not same.replaced["mask_orientation"]
    assert same.same["mask_shift"] == {"pattern_order"} and not same.idle
    assert same.chosen("mask_shift", {"dx": 1.9, "dy": 0.05}) == ["pattern_order"]
    assert same.chosen("mask_shift", {"dx": -0.5, "dy": 0.0}) == []


def test_behind_one_pixel_a_slot_a_delay_is_a_displacement() -> None:
    same = of(moving(frames=16, step=1))
    assert "mask_shift" in same.continuous("sync_offset")
