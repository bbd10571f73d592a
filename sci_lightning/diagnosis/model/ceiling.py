"""Where signal ends before the converter does: what is then recorded is no Gaussian but a part of one, and a spike."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch.special import ndtr, ndtri

NEAR = 6.0
"""Standard deviations from the ceiling beyond which a signal is Gaussian: untouched, or all of it in the spike."""
FAR = 8.0
"""Standard deviations beyond which probabilities are too small to be subtracted."""


@dataclass(frozen=True)
class Ceiling:
    """A signal that ends at a level, as a full well's does, noise of the readout added behind it.

    Attributes:
        mean, deviation: ``(N, H, W)`` DN, of the signal if it did not end, readout included.
        level: DN, as it is recorded; broadcasts to ``(N, H, W)``.
        read: DN, standard deviation of what is added behind.
    """

    mean: torch.Tensor
    deviation: torch.Tensor
    level: torch.Tensor
    read: torch.Tensor

    @cached_property
    def mixed(self) -> torch.Tensor:
        """Bool ``(N, H, W)``: where signal both reaches the level and stays below it.

        The readout is taken as small beside the signal's own noise; where it is not, a Gaussian serves as well.
        """
        return ((self.mean - self.level).abs() < NEAR * self.deviation) & (self.deviation > 1.5 * self.read)

    @cached_property
    def kept(self) -> torch.Tensor:
        """``(N, H, W)`` share of the signal that stays below the level: so much less the recorded mean moves."""
        return ndtr((self.level - self.mean) / self.deviation)

    def brighter(self, deviations: float) -> Ceiling:
        """The same behind more light."""
        return replace(self, mean=self.mean + deviations * self.deviation)

    def standardise(self, signal: torch.Tensor, else_: torch.Tensor) -> torch.Tensor:
        """Signal ``(N, H, W)`` in DN as standard normal numbers as probable; far from the level ``else_``."""
        if not self.mixed.any():
            return else_
        level, read = self.level.expand_as(self.mean), self.read.expand_as(self.mean)
        mean, deviation, level, read, at = (
            each[self.mixed].double() for each in (self.mean, self.deviation, level, read, signal)
        )
        below, beyond = (at - mean) / deviation, (at - level) / read
        lost = ndtr((mean - level) / deviation)  # of the signal, into the spike
        spike = lost * ndtr(beyond)
        under = torch.minimum(ndtr(below), 1 - lost) + spike
        over = torch.where(at < level, ndtr(-below) - spike, lost * ndtr(-beyond))
        place = torch.where(under < 0.5, ndtri(under), -ndtri(over.clamp(min=0)))
        place = torch.where(below < -FAR, below, place)
        place = torch.where(beyond > FAR, (beyond.square() - 2 * lost.clamp(min=1e-30).log()).sqrt(), place)
        return else_.masked_scatter(self.mixed, place.to(else_.dtype))
