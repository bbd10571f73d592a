"""An effect that competes in a blind search, and what it needs to be named."""

from __future__ import annotations

from dataclasses import dataclass

from sci_lightning.diagnosis.blind.blind_fit import BlindFit
from sci_lightning.diagnosis.blind.likelihood_comparison import FEW, Comparison

MIN_Z = 3.0
"""Standard deviations by which an effect must make the snapshots likelier."""
KEPT_Z = 2.0
"""The same of an effect that was named; lower, so that none is named and dropped by turns."""
MUCH = 100.0
"""Nats from which an effect of the mask's image needs :data:`KEPT_Z` standard deviations only: a wide blur leaves few
blocks. On validation clips no such effect that was not there has gained a third of it."""
MIN_AGREE = 0.75
"""Part of the snapshots that must ask for an effect."""
BY_CHANCE = 0.05
"""Probability of the snapshots' signed ranks by chance below which they agree about an effect that is not one of the
mask's image. It changes how brightness, fine detail or motion are distributed, which differs from scene to scene and is
alike all over a snapshot: the prior's errors look like such an effect, and blocks of one snapshot do not tell."""


@dataclass(frozen=True)
class Contender:
    """An effect that was fitted beside a model.

    Attributes:
        name: of the effect.
        fit: of the model with it.
        comparison: with the model without it.
        nats: calibrated nats that it gains.
        gain: the same beyond the penalty for its parameters.
        like_a_scene: whether it changes the image as a scene of another kind would.
    """

    name: str
    fit: BlindFit
    comparison: Comparison
    nats: float
    gain: float
    like_a_scene: bool = False

    @property
    def clear(self) -> bool:
        """Whether the effect is so well supported that it may be named."""
        return self.supported and (self.comparison.z > MIN_Z or self.nats >= MUCH)

    @property
    def supported(self) -> bool:
        """Whether the effect would be kept if it had been named."""
        comparison = self.comparison
        agree = comparison.agree >= MIN_AGREE * comparison.snapshots
        if self.like_a_scene:  # three or four snapshots have to be unanimous, fewer say nothing
            by_chance = max(BY_CHANCE, 0.5**comparison.snapshots)
            agree = agree and comparison.snapshots >= FEW and comparison.p_snapshots <= by_chance
        return agree and self.gain > 0 and comparison.z > KEPT_Z
