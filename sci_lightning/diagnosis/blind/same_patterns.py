"""Which candidates do the same to these patterns, so that snapshots behind them cannot tell which one it is.

Behind one mask that moves, a slot too late is a displacement; behind two levels no curve of the levels changes
anything. That is a matter of the patterns alone, and is found before the search: what every candidate makes of them is
compared with what every other one does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.diagnosis.model.starting_points import starting_settings
from sci_lightning.diagnosis.search.displacement import displacing_effects, starts_at
from sci_lightning.encoder.effects.parameter import part_of
from sci_lightning.encoder.effects.stage import ExposureEffect, ModulatorEffect, RelayEffect

TOLERANCE = 0.125
"""Part of the squared change of the patterns that another candidate may fail to reproduce: one slot of eight, because
an order goes on in a circle and a displacement does not. A magnification fails to reproduce 0.15 of a distortion."""
UNCHANGED = 1e-6
"""Part of the squared patterns below which a change is none."""
SIDE_PX, MARGIN_PX = 32, 8
"""Largest side in pixels of the middle of the field in which patterns are compared, and what is left around it: a
displaced image is dark where it ends."""


@dataclass(frozen=True)
class Change:
    """What a candidate at one of its starts does to the patterns.

    Attributes:
        name: of the candidate.
        setting: its start.
        values: ``(T * h * w,)`` by which the relative mask changes in the middle of the field.
    """

    name: str
    setting: Setting
    values: torch.Tensor


class SamePatterns:
    """Compares candidates by what they do to the patterns.

    Args:
        likelihood: knows the patterns.
        hypothesis: the ideal camera.
        names: of the candidates; those that leave the patterns alone are like no other one.

    Attributes:
        idle: candidates that change nothing behind these patterns.
        replaced: starts of discrete candidates that a continuous one reproduces, by the candidate.
        same: candidates that do the same as one, by its name.
    """

    def __init__(self, likelihood: BlindLikelihood, hypothesis: Hypothesis, names: Sequence[str]) -> None:
        self.likelihood, self.hypothesis = likelihood, hypothesis
        self.effects = likelihood.model.effects
        size = likelihood.model.observation.size
        first = [max(MARGIN_PX, (length - SIDE_PX) // 2) for length in size]
        rows, columns = (slice(one, length - one) for one, length in zip(first, size, strict=True))
        self._window = rows, columns
        self._requested = torch.zeros(size, dtype=torch.bool)
        self._requested[self._window] = True
        self._plain = self._image(hypothesis)
        of_the_mask = (ModulatorEffect, RelayEffect, ExposureEffect)
        compared = [name for name in names if issubclass(self.effects[name], of_the_mask)]
        every = {
            name: [self.change(name, start) for start in starting_settings(likelihood.model, name, hypothesis)]
            for name in compared
        }
        least = UNCHANGED * float(self._plain.square().sum())
        changes = {name: [one for one in some if _power(one) > least] for name, some in every.items()}
        self.idle = {name for name in compared if not (changes[name] or issubclass(self.effects[name], ExposureEffect))}
        self.replaced: dict[str, list[Setting]] = {name: [] for name in compared}
        self.same: dict[str, set[str]] = {name: set() for name in names}
        for name, some in changes.items():
            for other, reproducing in changes.items():
                if other == name or self.effects[other].is_discrete():
                    continue
                reproduced = [one for one in some if self.reproduces(one, [*reproducing, *self._displaced(one, other)])]
                if self.effects[name].is_discrete():
                    self.replaced[name] += [one.setting for one in reproduced]
                    together = bool(reproduced)
                else:
                    together = 0 < len(reproduced) == len(some)
                if together:
                    self.same[name].add(other)
                    self.same[other].add(name)

    def change(self, name: str, setting: Setting) -> Change:
        """Return what a candidate does to the patterns."""
        values = self._image(self.hypothesis.with_effect(name, setting)) - self._plain
        return Change(name, setting, values.flatten())

    def reproduces(self, change: Change, others: Sequence[Change]) -> bool:
        """Return whether another candidate, as strong as need be, changes the patterns in the same way."""
        power = _power(change)
        for other in others:
            strength = float(change.values @ other.values) / _power(other)
            explained = strength**2 * _power(other) / power
            if strength <= 0 or explained < 1 - 2 * TOLERANCE:
                continue
            setting = part_of(other.setting, self.effects[other.name].about, strength)
            there = self.change(other.name, setting).values
            if float((change.values - there).square().sum()) <= TOLERANCE * power:
                return True
        return False

    def continuous(self, name: str) -> list[str]:
        """Return the candidates that do the same as one, and are fitted as it is."""
        return sorted(other for other in self.same[name] if not self.effects[other].is_discrete())

    def chosen(self, name: str, setting: Setting) -> list[str]:
        """Return the discrete candidates of which one start does what an effect does at a setting."""
        here = self.change(name, setting)
        others = [other for other in self.same[name] if self.effects[other].is_discrete()]
        return sorted(
            other
            for other in others
            if any(
                float((here.values - self.change(other, start).values).square().sum()) <= TOLERANCE * _power(here)
                for start in self.replaced[other]
            )
        )

    def _displaced(self, change: Change, name: str) -> list[Change]:
        """Return what a candidate that displaces does where the changed patterns look most like the given ones."""
        effects = displacing_effects(self.likelihood.model, self.hypothesis)
        if name not in effects or not self.effects[change.name].is_discrete():
            return []
        size = [2 * length for length in self._plain.shape[1:]]
        images = (self._plain, self._plain + change.values.view_as(self._plain))
        before, after = (torch.fft.rfft2(image - image.mean(), s=size) for image in images)
        peak = int(torch.fft.irfft2((after * before.conj()).sum(0), s=size).argmax())
        down, across = (
            math.remainder(place, length) for place, length in zip(divmod(peak, size[1]), size, strict=True)
        )
        starts = starts_at([(across, down)], {name: effects[name]}, self.likelihood.model)[name]
        return [self.change(name, start) for start in starts if across or down]

    def _image(self, hypothesis: Hypothesis) -> torch.Tensor:
        """Return the relative mask in the middle of the field, ``(T, h, w)``."""
        sequence = self.likelihood.model.observation.sequences[0]
        image = self.likelihood.relative_mask(hypothesis, sequence, self._requested)
        return image[:, self._window[0], self._window[1]].float()


def _power(change: Change) -> float:
    return max(float(change.values.square().sum()), 1e-30)
