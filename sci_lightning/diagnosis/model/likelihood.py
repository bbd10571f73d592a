"""The likelihood of a pixel: the probability of the interval of signal that its DN stands for.

The signal is Gaussian before the converter, unless it saturates before the converter does
(:class:`ClippedSignal`). The converter rounds, and clips at 0 and at full scale, so that the intervals at both ends are
open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch.special import ndtr, ndtri

IMPOSSIBLE_CODE_NATS = -60.0
"""Log-probability of a code that a converter of so many bits does not have."""
MIN_DEVIATION_DN = 0.05
"""DN; behind a converter a smaller standard deviation cannot be told from none."""
BRIGHTER_SIGMAS = 0.01
"""Standard deviations over which the derivative by the light is taken near saturation."""
MIN_KEPT_SHARE = 1e-3
"""Share of the signal below saturation under which the recorded mean counts as independent of the light."""
FAR_TAIL_SIGMAS = -11.0
"""Standard deviations below which the error function leaves single precision and its asymptote is used."""
MIXED_SIGMAS = 6.0
"""Standard deviations from the saturation level beyond which a signal is either untouched or entirely saturated."""
NEGLIGIBLE_TAIL_SIGMAS = 8.0
"""Standard deviations beyond which probabilities are too small to be subtracted from 1."""


@dataclass(frozen=True)
class ClippedSignal:
    """A Gaussian signal that is clipped at a level below full scale (a full well), with read noise added afterwards.

    Its distribution is the part of the Gaussian below the level and a spike at the level, convolved with read noise.

    Attributes:
        mean, deviation: ``(N, H, W)`` DN, of the signal as it would be without clipping, read noise included.
        level: DN at which it is recorded when it is clipped; broadcasts to ``(N, H, W)``.
        read: DN, standard deviation of the noise that is added after clipping.
    """

    mean: torch.Tensor
    deviation: torch.Tensor
    level: torch.Tensor
    read: torch.Tensor

    @cached_property
    def mixed(self) -> torch.Tensor:
        """Bool ``(N, H, W)``: pixels whose signal is sometimes clipped and sometimes not.

        The read noise is taken as small beside the signal's own noise; where it is not, a Gaussian serves as well.
        """
        return ((self.mean - self.level).abs() < MIXED_SIGMAS * self.deviation) & (self.deviation > 1.5 * self.read)

    @cached_property
    def kept(self) -> torch.Tensor:
        """``(N, H, W)`` probability that the signal stays below the level: the recorded mean moves by so much less."""
        return ndtr((self.level - self.mean) / self.deviation)

    def brighter(self, deviations: float) -> ClippedSignal:
        """Return the same for more light, by so many standard deviations."""
        return replace(self, mean=self.mean + deviations * self.deviation)

    def standardise(self, signal: torch.Tensor, otherwise: torch.Tensor) -> torch.Tensor:
        """Return the standard normal number that is exceeded as often as the signal ``(N, H, W)``, in DN, is.

        Pixels that are not :attr:`mixed` get the value of ``otherwise``.
        """
        if not self.mixed.any():
            return otherwise
        level, read = self.level.expand_as(self.mean), self.read.expand_as(self.mean)
        mean, deviation, level, read, signal = (
            field[self.mixed].double() for field in (self.mean, self.deviation, level, read, signal)
        )
        from_mean, from_level = (signal - mean) / deviation, (signal - level) / read
        clipped = ndtr((mean - level) / deviation)
        spike = clipped * ndtr(from_level)
        lower = torch.minimum(ndtr(from_mean), 1 - clipped) + spike
        upper = torch.where(signal < level, ndtr(-from_mean) - spike, clipped * ndtr(-from_level))
        normal = torch.where(lower < 0.5, ndtri(lower), -ndtri(upper.clamp(min=0)))
        normal = torch.where(from_mean < -NEGLIGIBLE_TAIL_SIGMAS, from_mean, normal)
        far_above = (from_level.square() - 2 * clipped.clamp(min=1e-30).log()).sqrt()
        normal = torch.where(from_level > NEGLIGIBLE_TAIL_SIGMAS, far_above, normal)
        return otherwise.masked_scatter(self.mixed, normal.to(otherwise.dtype))


@dataclass(frozen=True)
class Prediction:
    """What a hypothesis predicts for every pixel before the converter.

    Attributes:
        mean: ``(N, H, W)`` expected signal, DN.
        deviation: ``(N, H, W)`` its standard deviation, DN.
        bits: effective bits of the converter.
        clipped: the distribution where the signal saturates before the converter does; None if it does not.
        window: rows and columns of the field that it is of; None where it is of no use.
    """

    mean: torch.Tensor
    deviation: torch.Tensor
    bits: int
    clipped: ClippedSignal | None = None
    window: tuple[slice, slice] | None = None

    @property
    def total_variance(self) -> torch.Tensor:
        """``(N, H, W)`` variance of a pixel's DN, DN squared, quantisation counted as noise."""
        return self.deviation.square() + 1 / 12


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
        """Return the signal interval that each raw DN represents.

        Args:
            dn: ``(N, H, W)`` raw DN.
            bit_depth: bits of the numbers.
            bits: effective bits of the converter, at most ``bit_depth``.
        """
        full, codes = 2**bit_depth - 1, 2**bits - 1
        code = torch.round(dn * (codes / full))
        step = full / codes
        low, high = (code - 0.5) * step, (code + 0.5) * step
        low[code == 0] = -math.inf
        high[code == codes] = math.inf
        possible = None if bits == bit_depth else torch.round(code * step) == dn
        return Intervals(low, high, possible)


class PixelLikelihood:
    """Log-likelihood of every pixel with its derivatives; these are computed when they are first needed.

    A fit needs the derivatives only where it stays, which is not known before the log-likelihood is.

    Args:
        intervals: what the DN stand for.
        prediction: of the signal before the converter.
    """

    def __init__(self, intervals: Intervals, prediction: Prediction) -> None:
        self._intervals, self._prediction = intervals, prediction
        self._low, self._high, self._sign = _standardise(intervals, prediction)
        self._value = _log_probability(self._low, self._high)

    @cached_property
    def log_likelihood(self) -> torch.Tensor:
        """``(N, H, W)``, nats."""
        possible = self._intervals.possible
        return self._value if possible is None else torch.where(possible, self._value, IMPOSSIBLE_CODE_NATS)

    @property
    def mean_gradient(self) -> torch.Tensor:
        """``(N, H, W)`` first derivative with respect to the mean, 1 / DN.

        Near saturation it is the derivative with respect to the light, scaled to the mean.
        """
        return self._derivatives[0]

    @property
    def mean_information(self) -> torch.Tensor:
        """``(N, H, W)`` minus the second derivative with respect to the mean, 1 / DN squared; never negative."""
        return self._derivatives[1]

    @property
    def spread_gradient(self) -> torch.Tensor:
        """``(N, H, W)`` first derivative with respect to the logarithm of the standard deviation."""
        return self._derivatives[2]

    @cached_property
    def spread_information(self) -> torch.Tensor:
        """``(N, H, W)`` Fisher information about the logarithm of the standard deviation."""
        variance = self._prediction.deviation.square()
        quantised = variance / (variance + 1 / 12)
        return 2 * quantised.square()

    @cached_property
    def _derivatives(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Gradient and information with respect to the mean, and gradient with respect to the logarithmic spread."""
        low, high, value = self._low, self._high, self._value
        deviation, clipped = self._prediction.deviation, self._prediction.clipped
        at_low, at_high = (_density_ratio(edge, value) for edge in (low, high))
        first = at_low - at_high
        second = _product(low, at_low) - _product(high, at_high)
        information = (first.square() - second).clamp(0, 1) / deviation.square()
        gradient = self._sign * first / deviation
        if clipped is not None and clipped.mixed.any():
            brighter = log_likelihood(
                self._intervals, replace(self._prediction, clipped=clipped.brighter(BRIGHTER_SIGMAS))
            )
            kept, spread = clipped.kept.clamp(min=MIN_KEPT_SHARE), clipped.deviation
            gradient = torch.where(clipped.mixed, (brighter - value) / (BRIGHTER_SIGMAS * spread * kept), gradient)
            information = torch.where(clipped.mixed, 1 / (spread.square() * kept), information)
        return gradient, information, second.clamp(-1, 1e4)


def log_likelihood(intervals: Intervals, prediction: Prediction) -> torch.Tensor:
    """Return the log-likelihood of every pixel, ``(N, H, W)`` in nats."""
    low, high = _standardise(intervals, prediction)[:2]
    value = _log_probability(low, high)
    return value if intervals.possible is None else torch.where(intervals.possible, value, IMPOSSIBLE_CODE_NATS)


def quantile_residuals(intervals: Intervals, prediction: Prediction, random: torch.Generator) -> torch.Tensor:
    """Return randomised quantile residuals ``(N, H, W)``: standard normal and independent when the model is right.

    A point is drawn from the DN's interval in proportion to the predicted density; far out, where probabilities
    vanish, the interval's nearer end stands for it. Dunn and Smyth, "Randomized Quantile Residuals" (1996).
    """
    low, high, sign = _standardise(intervals, prediction)
    low, high = low.double(), high.double()
    below, above = torch.special.ndtr(low), torch.special.ndtr(high)
    share = torch.rand(prediction.mean.shape, generator=random, dtype=torch.float64)
    drawn = torch.special.ndtri((below + share * (above - below)).clamp(1e-300, 1 - 1e-16))
    # a standardised interval lies below 0 or around it, so only its upper end can be too far out
    return (sign * torch.where(high < -8, high, drawn)).float()


def _standardise(intervals: Intervals, prediction: Prediction) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return both ends of the interval in standard deviations from the mean, and a sign.

    An interval above the mean is mirrored, because the error function is precise in the lower tail; the sign is then
    -1, else 1.
    """
    mean, deviation, clipped = prediction.mean, prediction.deviation, prediction.clipped
    low, high = (intervals.low - mean) / deviation, (intervals.high - mean) / deviation
    if clipped is not None:
        low, high = clipped.standardise(intervals.low, low), clipped.standardise(intervals.high, high)
    above = low > 0
    sign = 1 - 2 * above.to(mean.dtype)
    return torch.where(above, -high, low), torch.where(above, -low, high), sign


def _log_probability(low: torch.Tensor, high: torch.Tensor) -> torch.Tensor:
    """Return the logarithm of the normal probability between two standardised ends, ``high`` being the nearer to 0.

    In the lower tail the complementary error function is precise, and a difference of two of its values much faster
    than one of their logarithms; beyond its range, where few pixels are, the tail's asymptote is used.
    """
    between = 0.5 * (torch.special.erfc(high * -math.sqrt(0.5)) - torch.special.erfc(low * -math.sqrt(0.5)))
    value = torch.log(between.clamp(min=1e-37))
    far = ~(high > FAR_TAIL_SIGMAS)
    if not far.any():
        return value
    larger, smaller = _log_tail(high[far]), _log_tail(low[far])
    return value.masked_scatter(far, larger + torch.log(-torch.expm1((smaller - larger).clamp(max=-1e-7))))


def _log_tail(z: torch.Tensor) -> torch.Tensor:
    """Return the logarithm of the normal probability below z for z far below 0, by its asymptotic series."""
    z = z.clamp(max=FAR_TAIL_SIGMAS)
    inverse_square = 1 / z.square()
    series = torch.log1p(inverse_square * (inverse_square * (3 - 15 * inverse_square) - 1))
    return -0.5 * z.square() - torch.log(-z) - 0.5 * math.log(2 * math.pi) + series


def _density_ratio(edge: torch.Tensor, log_probability: torch.Tensor) -> torch.Tensor:
    """Return the normal density at an end of the interval, divided by the interval's probability."""
    return torch.exp((-edge.square() / 2 - 0.5 * math.log(2 * math.pi) - log_probability).clamp(max=60))


def _product(edge: torch.Tensor, density: torch.Tensor) -> torch.Tensor:
    """Return edge times density, which is 0 at infinity."""
    return torch.where(edge.isinf(), 0.0, edge * density)
