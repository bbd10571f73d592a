"""Screening of candidates in snapshots of unknown scenes: how much each of them gains by itself, on a few blocks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.blind.blind_fit import BlindFit, BlindFitter
from sci_lightning.diagnosis.blind.displacement import proposed_displacements
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood, spread
from sci_lightning.diagnosis.blind.parallel_map import on_every_core
from sci_lightning.diagnosis.model.hypothesis import Setting
from sci_lightning.diagnosis.model.starting_points import starting_settings
from sci_lightning.encoder.effects.parameter import part_of

SCREENED_BLOCKS = 64
"""Blocks on which candidates are screened, spread evenly over the field."""
TRIED_BLOCKS = 8
"""Of these, blocks that choose among the many starts of a candidate: most starts are wrong by thousands of nats."""
STARTS_FITTED = 3
"""Starts of a promising candidate that are fitted to the screened blocks."""
WEAK_START_SHARE = 0.25
"""Part of a start's distance from the neutral setting at which it is tried as well."""
FINAL_ITERATIONS = 4
"""Iterations of fits that start from a model that was fitted already."""


@dataclass(frozen=True)
class ScreenedCandidate:
    """An effect that a model lacks, fitted by itself.

    Attributes:
        name: of the effect.
        nats: that it gains on the screened blocks.
        start: its best setting there, from which a joint fit starts.
        promising: whether it was among the best before it was fitted.
    """

    name: str
    nats: float
    start: Setting
    promising: bool


class Screener:
    """Screens candidates on a few blocks.

    Args:
        fitter: fits hypotheses.
        usable: ``(blocks,)`` bool, the blocks to which models are fitted: only there their likelihood is known.
        border_share: largest part of the field by which the mask's image may be displaced.
        replaced: starts that are not tried, by candidate: another candidate does the same to these patterns.

    Attributes:
        blocks: ``(blocks,)`` bool, those that are screened; none of them is at the edge of the field, which most
            candidates leave.
    """

    def __init__(
        self, fitter: BlindFitter, usable: torch.Tensor, border_share: float, replaced: Mapping[str, Sequence[Setting]]
    ) -> None:
        self.fitter, self.border_share, self.replaced = fitter, border_share, replaced
        self.blocks = spread(usable & _inner(fitter.likelihood), SCREENED_BLOCKS)
        self._few = spread(self.blocks, TRIED_BLOCKS)

    def screen(self, base: BlindFit, names: Sequence[str], count: int, starts: int) -> list[ScreenedCandidate]:
        """Return every candidate that a model lacks, the one that gains most first.

        Every start is tried, the best ones at a part of their strength too. The likelihood has local maxima (a mask
        that is displaced by a whole cell), so that the best starts of the most promising candidates are fitted.

        Args:
            base: the model.
            names: of the candidates.
            count: candidates whose starts are fitted.
            starts: of each of them.
        """
        likelihood, model = self.fitter.likelihood, self.fitter.model
        proposed = proposed_displacements(likelihood, base.hypothesis, self.border_share)
        starts_of = {
            name: [
                *(
                    one
                    for one in starting_settings(model, name, base.hypothesis)
                    if one not in self.replaced.get(name, ())
                ),
                *proposed.get(name, []),
            ]
            for name in names
            if name not in base.hypothesis.effects
        }
        tried = self._tried(base, starts_of, self._few)
        weaker = {
            name: [part_of(start, model.effects[name].about, WEAK_START_SHARE) for _, start in trials[:STARTS_FITTED]]
            for name, trials in tried.items()
            if not model.effects[name].is_discrete()
        }
        # a start as strong as the effect usually is may lie beyond the maximum of a weak one
        for name, trials in self._tried(base, weaker, self._few).items():
            tried[name] = sorted([*tried[name], *trials], key=lambda trial: -trial[0])
        best_of = {name: [start for _, start in trials[:STARTS_FITTED]] for name, trials in tried.items()}
        tried = self._tried(base, best_of, self.blocks)
        ranked = sorted(((name, trials) for name, trials in tried.items() if trials), key=lambda one: -one[1][0][0])
        promising = {name for name, trials in ranked[:count] if trials[0][0] > 0}

        def best(candidate: tuple[str, list[tuple[float, Setting]]]) -> tuple[float, Setting]:
            name, trials = candidate
            return self._fitted_start(base, name, trials[:starts]) if name in promising else trials[0]

        settings = on_every_core(best, ranked, likelihood.at_a_time)
        named = zip((name for name, _ in ranked), settings, strict=True)
        screened = [ScreenedCandidate(name, nats, start, name in promising) for name, (nats, start) in named]
        return sorted(screened, key=lambda one: -one.nats)

    def _fitted_start(self, base: BlindFit, name: str, trials: list[tuple[float, Setting]]) -> tuple[float, Setting]:
        """Return nats and setting of the best of a few starts after a short fit beside the model as it stands."""
        if self.fitter.model.effects[name].is_discrete():
            return trials[0]

        def fitted(start: Setting, blocks: torch.Tensor) -> tuple[float, Setting]:
            hypothesis = base.hypothesis.with_effect(name, start)
            fit = self.fitter.fit(hypothesis, blocks, FINAL_ITERATIONS, alone=name, errors=False)
            return _gain(fit, base), fit.hypothesis.effects[name]

        best = max(trials, key=lambda trial: fitted(trial[1], self._few)[0]) if len(trials) > 1 else trials[0]
        return fitted(best[1], self.blocks)

    def _tried(
        self, base: BlindFit, starts: dict[str, list[Setting]], blocks: torch.Tensor
    ) -> dict[str, list[tuple[float, Setting]]]:
        """Return nats on some blocks and setting of every start as it stands, the best of a candidate first."""

        def nats(trial: tuple[str, Setting]) -> float:
            return _gain(self.fitter.evaluate(base.hypothesis.with_effect(*trial), blocks), base)

        trials = [(name, start) for name, settings in starts.items() for start in settings]
        gains = on_every_core(nats, trials, self.fitter.likelihood.at_a_time)
        tried = [(gain, *trial) for trial, gain in sorted(zip(trials, gains, strict=True), key=lambda one: -one[1])]
        return {one: [(gain, start) for gain, name, start in tried if name == one] for one in starts}


def _gain(fit: BlindFit, base: BlindFit) -> float:
    """Return the nats that a fit gains over a model on the blocks that count for both; -inf where there are none."""
    gained = fit.log_likelihood - base.log_likelihood
    return float(gained.nansum()) if gained.isfinite().any() else -math.inf


def _inner(likelihood: BlindLikelihood) -> torch.Tensor:
    """Return the blocks that are not at the edge of the field, ``(blocks,)`` bool."""
    inner = torch.zeros(likelihood.rows, likelihood.columns, dtype=torch.bool)
    inner[1 : likelihood.rows - 1, 1 : likelihood.columns - 1] = True
    return inner.flatten()
