"""An effect that competes in a blind search, and what it needs to be named."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from sci_lightning.diagnosis.blind.blind_fit import BlindFit, BlindFitter, price
from sci_lightning.diagnosis.blind.likelihood_comparison import FEW, Comparison, compare
from sci_lightning.diagnosis.model.recent import Recent
from sci_lightning.encoder.effects.stage import ModulatorEffect, RelayEffect

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
DARKEST_BY_NOISE = 4.0
"""Standard deviations of the noise below no light at which a snapshot's darkest pixels may be."""
JUDGED = 16
"""Hypotheses whose likelihood on all blocks is kept: many candidates are compared with the same one."""


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
        possible: whether there is light in the darkest pixels.
    """

    name: str
    fit: BlindFit
    comparison: Comparison
    nats: float
    gain: float
    like_a_scene: bool = False
    possible: bool = True

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
        return self.possible and agree and self.gain > 0 and comparison.z > KEPT_Z


class ContenderJudge:
    """Judges what speaks for an effect of a fitted model against the same model without it.

    Args:
        fitter: of the models.
        blocks: ``(blocks,)`` bool, all blocks that count; models are fitted to fewer.
        min_gain_nats: what an effect must gain beyond the penalty for its parameters.
    """

    def __init__(self, fitter: BlindFitter, blocks: torch.Tensor, min_gain_nats: float) -> None:
        self.fitter, self.blocks, self.min_gain_nats = fitter, blocks, min_gain_nats
        self._on_all: Recent[torch.Tensor] = Recent(JUDGED)

    def __call__(self, fit: BlindFit, without: BlindFit, name: str) -> Contender:
        """Return an effect of a fit with what speaks for it.

        Snapshots have to agree about an effect that looks like a scene of another kind, and the few blocks that are
        fitted say little about one snapshot: they are asked on all blocks. By some such fits there is less light than
        none where it is darkest.

        Args:
            fit: of the model with the effect.
            without: the fitted model without it.
            name: of the effect.
        """
        comparison = compare(fit.log_likelihood, without.log_likelihood, self.fitter.likelihood.columns)
        like_a_scene, possible = self.is_like_a_scene(name), True
        if like_a_scene and comparison.nats > 0:
            on_all = compare(self._score(fit), self._score(without), self.fitter.likelihood.columns)
            comparison = replace(on_all, nats=comparison.nats)
            possible = self.fitter.likelihood.below_no_light(fit.hypothesis) < DARKEST_BY_NOISE
        nats = self.nats(fit, name, comparison)
        gain = nats - price(fit, without) - self.min_gain_nats
        return Contender(name, fit, comparison, nats, gain, like_a_scene, possible)

    def nats(self, fit: BlindFit, name: str, comparison: Comparison) -> float:
        """Return the calibrated nats that an effect of a fit gains: no more than as snapshots agree about it."""
        much = comparison.nats >= MUCH and comparison.z > KEPT_Z and not self.is_like_a_scene(name)
        nats = max(comparison.calibrated, MUCH) if much else comparison.calibrated
        return min(nats, self.fitter.distance(fit, name))

    def asked_for(self, fit: BlindFit, rival: BlindFit) -> bool:
        """Return whether the snapshots themselves ask for a fit rather than for a rival, by all blocks of each.

        Args:
            fit: with an effect that is named.
            rival: with an effect in its place that looks like a scene of another kind.
        """
        on_all = compare(self._score(fit), self._score(rival), self.fitter.likelihood.columns)
        return on_all.nats > 0 and on_all.p_snapshots <= max(BY_CHANCE, 0.5**on_all.snapshots)

    def is_like_a_scene(self, name: str) -> bool:
        """Return whether an effect changes the image as a scene of another kind would, and not that of the mask."""
        return not issubclass(self.fitter.model.vocabulary[name], (ModulatorEffect, RelayEffect))

    def _score(self, fit: BlindFit) -> torch.Tensor:
        """Return the log-likelihood ``(blocks, N)`` of a fitted hypothesis on all blocks."""
        if not bool((self.blocks & ~fit.blocks).any()):
            return fit.log_likelihood
        key = tuple((name, *setting.items()) for name, setting in fit.hypothesis.effects.items())
        return self._on_all.get(key, lambda: self.fitter.evaluate(fit.hypothesis, self.blocks).log_likelihood)
