"""The probability of a DN, its derivatives, and residuals that are normal when the model is right."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.diagnosis.model.likelihood import (
    IMPOSSIBLE_CODE_NATS,
    Intervals,
    PixelLikelihood,
    Prediction,
    log_likelihood,
    quantile_residuals,
)

MEAN = torch.tensor([0.2, 3.0, 7.4, 14.9, 9.0])
DEVIATION = torch.tensor([0.8, 0.5, 2.0, 1.0, 0.3])
DN = torch.tensor([0.0, 4.0, 7.0, 15.0, 2.0])


def test_probabilities_of_all_codes_sum_to_one() -> None:
    codes = torch.arange(16.0)[:, None]
    values = log_likelihood(Intervals.of(codes.repeat(1, 5), 4, 4), Prediction(MEAN, DEVIATION, 4))
    torch.testing.assert_close(values.exp().sum(0), torch.ones(5))


def test_fewer_bits_leave_codes_that_cannot_be() -> None:
    values = log_likelihood(Intervals.of(torch.arange(16.0), 4, 2), Prediction(torch.tensor(7.0), torch.tensor(3.0), 2))
    assert (values > IMPOSSIBLE_CODE_NATS).nonzero()[:, 0].tolist() == [0, 5, 10, 15]
    torch.testing.assert_close(values[values > IMPOSSIBLE_CODE_NATS].exp().sum(), torch.tensor(1.0))


def test_derivatives_are_those_of_the_log_likelihood() -> None:
    intervals = Intervals.of(DN.double(), 4, 4)
    mean, deviation, step = MEAN.double(), DEVIATION.double(), 1e-4

    def value(by_mean: float, by_spread: float) -> torch.Tensor:
        return log_likelihood(
            intervals, Prediction(mean + by_mean, deviation * torch.tensor(by_spread).double().exp(), 4)
        )

    likelihood = PixelLikelihood(intervals, Prediction(mean, deviation, 4))
    by_mean = (value(step, 0) - value(-step, 0)) / (2 * step)
    by_spread = (value(0, step) - value(0, -step)) / (2 * step)
    torch.testing.assert_close(likelihood.mean_gradient, by_mean, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(likelihood.spread_gradient, by_spread, rtol=1e-4, atol=1e-4)
    curvature = (value(step, 0) - 2 * value(0, 0) + value(-step, 0)) / step**2
    torch.testing.assert_close(likelihood.mean_information, -curvature, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("level", [0.0, 0.3, 40.0, 254.8])
def test_residuals_are_standard_normal_at_both_ends_and_between(level: float) -> None:
    random = torch.Generator().manual_seed(0)
    signal = level + 0.8 * torch.randn(40000, generator=random)
    intervals = Intervals.of(signal.round().clamp(0, 255), 8, 8)
    mean, deviation = torch.full_like(signal, level), torch.full_like(signal, 0.8)
    residual = quantile_residuals(intervals, Prediction(mean, deviation, 8), random)
    assert abs(float(residual.mean())) < 0.02
    assert float(residual.std()) == pytest.approx(1, abs=0.02)


def test_residuals_far_out_stay_finite_and_keep_their_sign() -> None:
    intervals = Intervals.of(torch.tensor([100.0, 200.0]), 8, 8)
    prediction = Prediction(torch.tensor([200.0, 100.0]), torch.ones(2), 8)
    residual = quantile_residuals(intervals, prediction, torch.Generator())
    assert residual[0] < -90 and residual[1] > 90 and residual.isfinite().all()
