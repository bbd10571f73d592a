"""GAP and ADMM: what they converge to, when they stop, and what they refuse."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch.nn.functional import interpolate

from sci_lightning.decoder import ADMM, GAP
from sci_lightning.decoder.denoiser import WNNM, Denoiser, TotalVariation
from sci_lightning.decoder.iterative import Iterative
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator

BOTH = pytest.mark.parametrize("algorithm", [GAP, ADMM])


class Count(Denoiser):
    """Remembers the strengths it is called with, and changes nothing or too much."""

    def __init__(self, factor: float = 1) -> None:
        super().__init__()
        self.factor, self.told = factor, list[float]()

    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        self.told.append(strength)
        return self.factor * video


def smooth_scene(frames: int = 4) -> torch.Tensor:
    return interpolate(torch.rand(2, frames, 3, 3), (24, 24), mode="bilinear")


def error(estimate: torch.Tensor, video: torch.Tensor) -> float:
    return float((estimate - video).square().mean())


@BOTH
@pytest.mark.parametrize("gray", [False, True])
def test_better_than_the_mean_frame(algorithm: type[Iterative], gray: bool) -> None:
    video, mask = smooth_scene(), torch.rand(4, 24, 24)
    mask = mask / mask.sum(0) if gray else (mask < 0.5).float()
    mask[:, 5, 5] = 0  # never opens
    measurement = SnapshotOperator(mask)(video)
    estimate = algorithm(TotalVariation(), [0.05], [40])(measurement, mask)
    assert error(estimate, video) < 0.3 * error(SnapshotOperator(mask).mean_video(measurement), video)
    assert (estimate[..., 5, 5] - video[..., 5, 5]).abs().max() < 0.2  # the neighbours tell
    assert (measurement - SnapshotOperator(mask)(estimate)).square().mean().sqrt() < 0.01


def test_without_a_prior_gap_explains_the_measurement() -> None:
    video, mask = torch.rand(2, 5, 8, 8), torch.rand(5, 8, 8)
    estimate = GAP(Count(), [1.0], [1])(SnapshotOperator(mask)(video), mask)
    torch.testing.assert_close(SnapshotOperator(mask)(estimate), SnapshotOperator(mask)(video))


@BOTH
def test_schedule(algorithm: type[Iterative]) -> None:
    denoiser = Count()
    algorithm(denoiser, [0.2, 0.1], [2, 3])(torch.rand(1, 6, 6), torch.rand(4, 6, 6))
    assert denoiser.told == [0.2, 0.2, 0.1, 0.1, 0.1]


@BOTH
def test_stops_by_residual(algorithm: type[Iterative]) -> None:
    video, mask = smooth_scene(), (torch.rand(4, 24, 24) < 0.5).float()
    measurement = SnapshotOperator(mask)(video)

    def reached(tolerance: float | None) -> tuple[int, float]:
        calls = []
        denoiser = TotalVariation()
        denoiser.register_forward_hook(lambda *_: calls.append(1))
        estimate = algorithm(denoiser, [0.05], [30], tolerance)(measurement, mask)
        worst = (measurement - SnapshotOperator(mask)(estimate)).square().mean((1, 2)).sqrt().max()
        return len(calls), float(worst)

    (early, rough), (all_of_them, _) = reached(0.02), reached(None)
    assert 0 < early < all_of_them == 30 and rough < 0.02


@BOTH
def test_watched(algorithm: type[Iterative]) -> None:
    video, mask = smooth_scene(), (torch.rand(4, 24, 24) < 0.5).float()
    measurement, told = SnapshotOperator(mask)(video), []
    decoder = algorithm(TotalVariation(), [0.05], [3])
    decoder.watch = told.append
    estimate = decoder(measurement, mask)
    assert [(each.number, each.of) for each in told] == [(1, 3), (2, 3), (3, 3)]
    worst = (measurement - SnapshotOperator(mask)(estimate)).square().mean((1, 2)).sqrt().max()
    assert told[-1].residual == pytest.approx(float(worst))
    assert str(told[-1]) == f"iteration 3 of 3, residual {worst:.4f}"


@BOTH
def test_starts_from_another(algorithm: type[Iterative]) -> None:
    mask, measurement = (torch.rand(4, 24, 24) < 0.5).float(), torch.rand(2, 24, 24)
    first = GAP(TotalVariation(), [0.05], [5])
    given: list[torch.Tensor] = []
    started = algorithm(Count(), [0.1], [1], start=first)
    started.denoiser.register_forward_pre_hook(lambda _, inputs: given.append(inputs[0]))
    started(measurement, mask)
    algorithm(started.denoiser, [0.1], [1])(measurement, mask)
    from_first, from_mean = given
    assert not torch.equal(from_first, from_mean)
    close = (from_first - first(measurement, mask)).square().mean()
    assert close < (from_mean - first(measurement, mask)).square().mean()


@BOTH
def test_every_call_starts_afresh(algorithm: type[Iterative]) -> None:
    mask, (one, other) = (torch.rand(4, 16, 16) < 0.5).float(), torch.rand(2, 1, 16, 16)
    decoder = algorithm(WNNM(patch=4, step=2, neighbours=6, every=5), [0.1], [3])
    expected = decoder(one, mask)
    decoder(other, mask)
    assert torch.equal(decoder(one, mask), expected)


@BOTH
def test_stops_when_it_diverges(algorithm: type[Iterative]) -> None:
    mask = (torch.rand(4, 8, 8) < 0.5).float()
    with pytest.raises(BadInput, match=r"iteration \d+ of 500: .*(nan|inf)") as caught:
        algorithm(Count(factor=-3), [0.1], [500])(torch.rand(1, 8, 8), mask)
    assert "\n" not in str(caught.value)
    with pytest.raises(BadInput, match="iteration 1 of 3: the residual became nan"):
        algorithm(TotalVariation(), [0.1], [3])(torch.full((1, 8, 8), torch.nan), mask)


@BOTH
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"strengths": [0.1, 0]}, r"decoder.strengths=\[0.1, 0\]: must be positive"),
        ({"strengths": [0.1, torch.nan]}, "decoder.strengths"),
        ({"iterations": [5, 0]}, r"decoder.iterations=\[5, 0\]: must be at least 1"),
        ({"iterations": [5]}, "as many numbers of iterations as strengths"),
        ({"strengths": [], "iterations": []}, "as many numbers of iterations as strengths"),
        ({"tolerance": 0}, "decoder.tolerance=0: must be positive"),
    ],
)
def test_settings_that_are_refused(algorithm: type[Iterative], settings: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInput, match=message):
        algorithm(TotalVariation(), **{"strengths": [0.2, 0.1], "iterations": [5, 5], **settings})


def test_gamma() -> None:
    with pytest.raises(BadInput, match=r"decoder.gamma=0: must be positive"):
        ADMM(TotalVariation(), [0.1], [5], gamma=0)


def test_a_long_plan_takes_no_memory() -> None:
    decoder = GAP(TotalVariation(), [0.1, 0.2], [9999, 1])
    assert decoder.iterations == 10_000
    assert next(decoder.schedule()) == (0, 0.1)
