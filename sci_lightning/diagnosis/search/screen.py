"""A cheap look at every candidate: how many nats it would gain, to second order, and where its fit should start."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.linear import Linear
from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis, Setting
from sci_lightning.diagnosis.model.fixed_pattern_map import chart_of
from sci_lightning.encoder.effects.parameter import Parameter, Value

BATCH = 12
"""Starts whose predictions are held in memory at a time."""


@dataclass(frozen=True)
class Candidate:
    """An effect that might be added.

    Attributes:
        name: of the effect.
        gain: nats, estimated.
        start: where a fit of it should begin.
    """

    name: str
    gain: float
    start: Setting

    def added(self, model: CameraModel, hypothesis: Hypothesis) -> Hypothesis:
        """The hypothesis with the candidate at its start, its map, if it has one, all 0."""
        return model.adding(hypothesis, self.name, self.start, model.blank_chart(self.name))


def screen(fitter: Fitter, base: Fit) -> list[Candidate]:
    """Every effect of the vocabulary that the hypothesis lacks, the most promising first.

    Noise terms are left out: they explain variance, and must not be asked about the mean.
    """
    model, prediction = fitter.model, base.prediction
    now, linear = fitter.score(prediction), Linear(fitter, base)
    deviation = prediction.deviation
    chi2 = _chi2(fitter, prediction.mean, deviation)
    found = []
    for name, effect in model.vocabulary.items():
        if name in base.hypothesis.effects or effect.noise:
            continue
        if effect.map_kind:
            chart = chart_of(model, base.hypothesis, name, prediction, now, fitter.use)
            start: Setting = dict.fromkeys(effect.about, chart.std)
            found.append(Candidate(name, chart.evidence, start))
            continue
        starts = model.starts(name, base.hypothesis)
        if not starts:  # a converter of one bit can lose none, a single slot cannot come late
            continue
        found.append(
            max(
                (
                    candidate
                    for first in range(0, len(starts), BATCH)
                    for candidate in _candidates(fitter, base, name, starts[first : first + BATCH], linear, chi2)
                ),
                key=lambda each: each.gain,
            )
        )
    return sorted(found, key=lambda each: -each.gain)


def nearer(start: Setting, about: dict[str, Parameter], factor: float) -> Setting:
    """So many times as far from the neutral setting."""

    def moved(value: Value, of: Parameter) -> Value:
        if of.choices or not isinstance(of.neutral, (int, float)):
            return value
        return min(max(of.neutral + min(factor, 2.0) * (float(value) - of.neutral), of.low), of.high)

    return {name: moved(value, about[name]) for name, value in start.items()}


def _candidates(
    fitter: Fitter, base: Fit, name: str, starts: list[Setting], linear: Linear, chi2: torch.Tensor
) -> list[Candidate]:
    """Each start with the nats of a large change, by chi2, or those of a small one, to second order: then nearer."""
    about = fitter.model.known[name].about
    model = fitter.model
    trials = [model.predict(model.adding(base.hypothesis, name, start)) for start in starts]
    if any(trial.bits != base.prediction.bits for trial in trials):
        gains = [float(((fitter.values(trial) - linear.value) * fitter.use).sum()) for trial in trials]
        return [Candidate(name, gain, start) for gain, start in zip(gains, starts, strict=True)]
    deviation, count = base.prediction.deviation, float(fitter.use.sum())
    far = [0.5 * count * float(torch.log(chi2 / _chi2(fitter, trial.mean, deviation))) for trial in trials]
    found = [Candidate(name, gain, start) for gain, start in zip(far, starts, strict=True)]
    if not any(each.choices for each in about.values()):
        near, factors = linear.each(torch.stack([trial.mean - base.prediction.mean for trial in trials]))
        for i, (gain, factor) in enumerate(zip(near.tolist(), factors.tolist(), strict=True)):
            if gain > found[i].gain:
                found[i] = Candidate(name, gain, nearer(starts[i], about, factor))
    return found


def _chi2(fitter: Fitter, mean: torch.Tensor, deviation: torch.Tensor) -> torch.Tensor:
    """Mean square of the distance to the DN's interval, over the fitted pixels, quantisation counted as noise."""
    intervals = fitter.intervals(fitter.model.observation.bit_depth)
    distance = (intervals.low - mean).clamp(min=0) + (mean - intervals.high).clamp(min=0)
    inside = fitter.model.observation.dn - mean
    distance = torch.where(intervals.low.isinf() | intervals.high.isinf(), distance, inside)
    return (distance.square() / (deviation.square() + 1 / 12) * fitter.use).sum() / fitter.use.sum()
