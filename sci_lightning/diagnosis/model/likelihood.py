"""How probable a DN is: the probability of the interval it stands for, tails at the ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.model.ceiling import Ceiling

IMPOSSIBLE = -60.0
"""Log-probability of a code that a converter of so many bits does not have."""
LEAST_DEVIATION = 0.05
"""DN; noise below it cannot be told from none behind a converter."""
BRIGHTER = 0.01
"""Standard deviations over which the derivative by the light is taken near a ceiling."""
LEAST_KEPT = 1e-3
"""Share of the signal below a ceiling under which a change of light is no longer followed."""

FAR = -11.0
"""Standard deviations below which the error function leaves single precision."""


@dataclass(frozen=True)
class Intervals:
    """The interval of signal that every pixel's DN stands for.

    Attributes:
        low, high: ``(N, H, W)`` its ends in DN, infinite at 0 and at full scale.
        possible: ``(N, H, W)`` whether a converter of so many bits has this code at all; None when all do.
    """

    low: torch.Tensor
    high: torch.Tensor
    possible: torch.Tensor | None

    @staticmethod
    def of(dn: torch.Tensor, bit_depth: int, bits: int) -> Intervals:
        """Of raw DN ``(N, H, W)`` of ``bit_depth`` bits, out of a converter of which ``bits`` are effective."""
        full, codes = 2**bit_depth - 1, 2**bits - 1
        code = torch.round(dn * (codes / full))
        step = full / codes
        low, high = (code - 0.5) * step, (code + 0.5) * step
        low[code == 0] = -math.inf
        high[code == codes] = math.inf
        possible = None if bits == bit_depth else torch.round(code * step) == dn
        return Intervals(low, high, possible)


@dataclass(frozen=True)
class Score:
    """Log-likelihood of every pixel and its derivatives.

    Attributes:
        value: ``(N, H, W)`` nats.
        slope: by the mean, 1 / DN.
        weight: minus the second derivative by the mean, 1 / DN squared; never negative.
        spread: by the logarithm of the standard deviation.
        spread_weight: the information about that logarithm.
    """

    value: torch.Tensor
    slope: torch.Tensor
    weight: torch.Tensor
    spread: torch.Tensor
    spread_weight: torch.Tensor


def log_likelihood(
    intervals: Intervals, mean: torch.Tensor, deviation: torch.Tensor, ceiling: Ceiling | None = None
) -> torch.Tensor:
    """``(N, H, W)`` nats, of Gaussian signal of this mean and deviation (DN), unless it ends at a ceiling."""
    low, high = _ordered(intervals, mean, deviation, ceiling)[:2]
    value = _log_difference(low, high)
    return value if intervals.possible is None else torch.where(intervals.possible, value, IMPOSSIBLE)


def score(intervals: Intervals, mean: torch.Tensor, deviation: torch.Tensor, ceiling: Ceiling | None = None) -> Score:
    """Log-likelihood and derivatives at a prediction; see :class:`Score`; near a ceiling, by the light."""
    low, high, sign = _ordered(intervals, mean, deviation, ceiling)
    value = _log_difference(low, high)
    at_low, at_high = (_density_over(edge, value) for edge in (low, high))  # density over the interval's probability
    first = at_low - at_high
    second = _times(low, at_low) - _times(high, at_high)
    weight = (first.square() - second).clamp(0, 1) / deviation.square()
    slope = sign * first / deviation
    if ceiling is not None and ceiling.mixed.any():
        brighter = log_likelihood(intervals, mean, deviation, ceiling.brighter(BRIGHTER))
        kept, spread = ceiling.kept.clamp(min=LEAST_KEPT), ceiling.deviation
        slope = torch.where(ceiling.mixed, (brighter - value) / (BRIGHTER * spread * kept), slope)
        weight = torch.where(ceiling.mixed, 1 / (spread.square() * kept), weight)
    quantised = deviation.square() / (deviation.square() + 1 / 12)
    if intervals.possible is not None:
        value = torch.where(intervals.possible, value, IMPOSSIBLE)
    return Score(
        value,
        slope,
        weight,
        second.clamp(-1, 1e4),
        2 * quantised.square(),
    )


def quantile_residuals(
    intervals: Intervals,
    mean: torch.Tensor,
    deviation: torch.Tensor,
    random: torch.Generator,
    ceiling: Ceiling | None = None,
) -> torch.Tensor:
    """Randomised quantile residuals ``(N, H, W)``: standard normal, independent, when the model is right.

    A point is drawn from the DN's interval in proportion to the predicted density; far out, where probabilities
    vanish, the interval's nearer end stands for it. Dunn and Smyth, "Randomized Quantile Residuals" (1996).
    """
    low, high, sign = _ordered(intervals, mean, deviation, ceiling)
    low, high = low.double(), high.double()
    below, above = torch.special.ndtr(low), torch.special.ndtr(high)
    share = torch.rand(mean.shape, generator=random, dtype=torch.float64)
    drawn = torch.special.ndtri((below + share * (above - below)).clamp(1e-300, 1 - 1e-16))
    # after ordering an interval lies below 0 or around it, so only its upper end can be too far out
    return (sign * torch.where(high < -8, high, drawn)).float()


def _ordered(
    intervals: Intervals, mean: torch.Tensor, deviation: torch.Tensor, ceiling: Ceiling | None
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """The standardised interval, mirrored where it lies above the mean, and the sign of the mirroring."""
    low, high = (intervals.low - mean) / deviation, (intervals.high - mean) / deviation
    if ceiling is not None:
        low, high = ceiling.standardise(intervals.low, low), ceiling.standardise(intervals.high, high)
    above = low > 0
    sign = 1 - 2 * above.to(mean.dtype)
    return torch.where(above, -high, low), torch.where(above, -low, high), sign


def _log_difference(low: torch.Tensor, high: torch.Tensor) -> torch.Tensor:
    """Logarithm of the normal probability between two ordered places, of which the upper is the nearer to 0.

    In the lower tail the complementary error function is precise, and a difference of two of its values much faster
    than one of their logarithms; beyond its range the tail's asymptote stands in for it.
    """
    between = 0.5 * (torch.special.erfc(high * -math.sqrt(0.5)) - torch.special.erfc(low * -math.sqrt(0.5)))
    larger, smaller = _tail(high), _tail(low)
    far = larger + torch.log(-torch.expm1((smaller - larger).clamp(max=-1e-7)))
    return torch.where(high > FAR, torch.log(between.clamp(min=1e-37)), far)


def _tail(place: torch.Tensor) -> torch.Tensor:
    """Logarithm of the normal probability below a place that is far below 0, asymptotically."""
    place = place.clamp(max=FAR)
    by = 1 / place.square()
    series = torch.log1p(by * (by * (3 - 15 * by) - 1))
    return -0.5 * place.square() - torch.log(-place) - 0.5 * math.log(2 * math.pi) + series


def _density_over(edge: torch.Tensor, log_probability: torch.Tensor) -> torch.Tensor:
    return torch.exp((-edge.square() / 2 - 0.5 * math.log(2 * math.pi) - log_probability).clamp(max=60))


def _times(edge: torch.Tensor, density: torch.Tensor) -> torch.Tensor:
    """edge * density, 0 at infinity."""
    return torch.where(edge.isinf(), 0.0, edge * density)
