"""A cheap look at candidates before any is fitted: how many nats each would gain, and where its fit should start."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.information_criterion import ABANDON_NATS
from sci_lightning.diagnosis.fit.local_gain import LocalGain
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.diagnosis.model.likelihood import Prediction
from sci_lightning.diagnosis.model.smooth_map import estimate_map
from sci_lightning.diagnosis.model.starting_points import starting_settings, with_effect_at
from sci_lightning.encoder.effects.parameter import part_of, within

STARTS_IN_MEMORY = 12
"""Starts whose predictions are held in memory at a time."""

INVISIBLE_DN = 1e-3
"""Largest change of the predicted DN by which an effect does nothing in these captures, and is no candidate."""

COARSE_NATS = 100.0
"""Gain on some of the pixels from which a candidate is strong: far above what chance gives."""

RIVAL_NATS = 24.0
"""Nats of an effect's evidence that another effect may leave unexplained and still be fitted in its place; well above
``SearchSettings.indistinct_nats``, because screening is only accurate to second order."""

RIVAL_FRACTION = 0.03
"""The same as a part of the evidence, because large effects are not linear."""

RIVAL_STARTS = 12
"""Settings of a rival from which its screening starts; it bounds the run time."""

SCREENED_FROM_KINK_PIXELS = 0.2
"""Pixels on either side of a whole displacement at which it is screened again: half of what its starts are apart."""


@dataclass(frozen=True)
class Candidate:
    """An effect that might be added to the model.

    Attributes:
        name: of the effect.
        gain: estimated gain in log-likelihood, nats.
        start: setting from which a fit of it should start.
    """

    name: str
    gain: float
    start: Setting

    def added(self, model: CameraModel, hypothesis: Hypothesis) -> Hypothesis:
        """Return the hypothesis with the candidate at its start; its map, if it has one, is 0 everywhere."""
        return with_effect_at(model, hypothesis, self.name, self.start)


def screen(base: Fit, further: Mapping[str, list[Setting]] | None = None, part: float = 1.0) -> list[Candidate]:
    """Estimate the gain of every effect of the vocabulary that the model lacks; the most promising comes first.

    Noise is left out: it explains variance, and says nothing about the mean. Where pixels are many, a part of them
    is looked at first. That suffices as long as one of the candidates is strong.

    Args:
        base: the fitted model.
        further: starts by effect beside those that the effect always has.
        part: of the starts' distance from doing nothing that is tried.
    """
    coarse = base.seen_coarsely()
    if coarse is not base:
        candidates = _screened(coarse, further or {}, part)
        if candidates and candidates[0].gain > COARSE_NATS:
            surplus = float(base.fitter.fitted.sum() / coarse.fitter.fitted.sum())
            return [replace(candidate, gain=candidate.gain * surplus) for candidate in candidates]
    return _screened(base, further or {}, part)


def _screened(base: Fit, further: Mapping[str, list[Setting]], part: float) -> list[Candidate]:
    """Estimate the gain of every candidate on the pixels that count for a fit."""
    fitter, model, local = base.fitter, base.fitter.model, LocalGain(base)
    candidates, maps = [], fitter.maps(local.at)
    for name, effect in model.vocabulary.items():
        if name in base.hypothesis.effects or effect.noise:
            continue
        if effect.map_kind:
            one = estimate_map(model, local.at, name, fitter.fitted, maps)
            start: Setting = dict.fromkeys(effect.about, one.std)
            candidates.append(Candidate(name, one.evidence, start))
            continue
        all_starts = starting_settings(model, name, base.hypothesis) + further.get(name, [])
        starts = [part_of(start, effect.about, part) for start in all_starts]
        if not starts:  # a converter of one bit can lose none, a single slot cannot come late
            continue
        screened = _screen_starts(local, name, starts)
        if not screened:  # bit planes of binary patterns
            continue
        best = max(screened, key=lambda one: one.gain)
        nearby = [one for one in _on_both_sides(best.start, effect.displacement or ()) if within(one, effect.about)]
        if nearby and best.gain > fitter.settings.min_gain_nats:
            best = max(best, *_screen_starts(local, name, nearby), key=lambda one: one.gain)
        candidates.append(best)
    return sorted(candidates, key=lambda candidate: -candidate.gain)


def _screen_starts(local: LocalGain, name: str, starts: list[Setting]) -> list[Candidate]:
    """Estimate the gain of the starts of one effect that change something, some at a time."""
    some = (starts[first : first + STARTS_IN_MEMORY] for first in range(0, len(starts), STARTS_IN_MEMORY))
    return [candidate for few in some for candidate in _screen_few(local, name, few)]


def _on_both_sides(start: Setting, parameters: Sequence[str]) -> list[Setting]:
    """Return the settings on the other side of the nearest whole displacement; on both sides of one that is whole.

    Where the edges of pixels and mirrors meet, the likelihood has a kink, and a maximum of its own on either side: the
    nearest start may lie on the wrong one, and a fit that begins on the kink may end there.
    """
    choices = []
    for name in parameters:
        place = float(start[name])
        whole = float(round(place))
        choices.append(
            (place - SCREENED_FROM_KINK_PIXELS, place, place + SCREENED_FROM_KINK_PIXELS)
            if place == whole
            else (place, 2 * whole - place)
        )
    settings = [{**start, **dict(zip(parameters, moved, strict=True))} for moved in product(*choices)]
    return [setting for setting in settings if setting != start]


def _screen_few(local: LocalGain, name: str, starts: list[Setting]) -> list[Candidate]:
    """Estimate the gain of every start of one effect that changes something.

    The gain is the larger of two estimates: that of the effect as large as the start, from chi2, and that of the effect
    scaled to its best size, to second order; the start is then scaled likewise.
    """
    fitter, at, model = local.fitter, local.at, local.fitter.model
    about = model.effects[name].about
    tried = [(start, model.predict(with_effect_at(model, at.hypothesis, name, start))) for start in starts]
    tried = [(start, one) for start, one in tried if _changes(one, at.prediction)]
    if not tried:
        return []
    starts, predictions = [start for start, _ in tried], [one for _, one in tried]
    if any(one.bits != at.prediction.bits for one in predictions):
        before = at.likelihood.log_likelihood
        gains = [float(((fitter.log_likelihood(one) - before) * fitter.fitted).sum()) for one in predictions]
        return [Candidate(name, gain, start) for gain, start in zip(gains, starts, strict=True)]
    deviation, count = at.prediction.deviation, float(fitter.fitted.sum())
    chi2 = _chi2(fitter, at.prediction.mean, deviation)
    large = [0.5 * count * float(torch.log(chi2 / _chi2(fitter, one.mean, deviation))) for one in predictions]
    candidates = [Candidate(name, gain, start) for gain, start in zip(large, starts, strict=True)]
    if not model.effects[name].is_discrete():
        changes = torch.stack([one.mean - at.prediction.mean for one in predictions])
        small, factors = local.gain_of_single_changes(changes)
        for i, (gain, factor) in enumerate(zip(small.tolist(), factors.tolist(), strict=True)):
            if gain > candidates[i].gain:
                candidates[i] = Candidate(name, gain, part_of(starts[i], about, min(factor, 2.0)))
    return candidates


def _changes(one: Prediction, other: Prediction) -> bool:
    """Return whether two predictions differ."""
    return one.bits != other.bits or float((one.mean - other.mean).abs().max()) > INVISIBLE_DN


def rivals(fit: Fit, without: Fit, name: str, only: Collection[str] | None = None) -> list[tuple[str, Fit]]:
    """Fit other effects in the place of one, those that may explain nearly as much.

    Which these are follows from the information that the captures hold about the effect and the other together, with
    everything in the model free to respond: the part of the effect's evidence that the other cannot explain.

    Args:
        fit: with the effect.
        without: the best fit without it.
        name: of the effect.
        only: other effects that are considered; None for all.
    """
    fitter, model, settings = fit.fitter, fit.fitter.model, fit.fitter.settings
    if model.effects[name].noise or model.effects[name].is_discrete():
        return []
    seen = without.seen_coarsely()
    coarse, local = seen.fitter, LocalGain(seen, errors_follow=False)
    base = without.hypothesis
    for error in model.imperfections:  # what the effect explains, errors of captures have taken over without it
        if error in base.effects:
            base = base.with_effect(error, fit.hypothesis.effects[error], fit.hypothesis.maps.get(error))
    nothing = coarse.model.predict(base).mean
    change = coarse.predicted(fit).mean - nothing
    evidence = fit.log_likelihood - without.log_likelihood
    allowed = max(RIVAL_FRACTION, RIVAL_NATS / max(evidence, 1.0))
    close = []
    for other, effect in model.vocabulary.items():
        if other in fit.hypothesis.effects or effect.noise or effect.map_kind or other not in (only or [other]):
            continue
        starts = starting_settings(model, other, without.hypothesis)[:RIVAL_STARTS]
        predictions = [coarse.model.predict(with_effect_at(model, base, other, start)) for start in starts]
        if not predictions or any(one.bits != seen.prediction.bits for one in predictions):
            continue
        changes = torch.stack([change, *(one.mean - nothing for one in predictions)])
        information = local.joint_gain(changes).information
        unexplained = _unexplained(information)
        if unexplained < allowed:
            size = information.diagonal()[1:].clamp(min=1e-9)
            best = int((information[0, 1:].square() / size).argmax())
            factor = min(max(float(information[0, 1 + best] / size[best]), 1e-3), 1.0)
            close.append((unexplained, other, part_of(starts[best], effect.about, factor)))
    close.sort(key=lambda rival: rival[0])
    to_reach = fit.fitted_log_likelihood - ABANDON_NATS
    same = [rival for rival in close if model.effects[rival[1]].plainer == name]  # takes no other rival's place
    chosen = same + [rival for rival in close if rival not in same][: settings.rivals_fitted]
    added = {other: with_effect_at(model, without.hypothesis, other, start) for _, other, start in chosen}
    fits = [(other, fitter.fit(begin, 20, to_reach=to_reach, from_afar=True)) for other, begin in added.items()]
    return [(other, rival) for other, rival in fits if not rival.abandoned]


def _unexplained(information: torch.Tensor) -> float:
    """Return the part of the first change that no linear combination of the others explains."""
    own = float(information[0, 0])
    if own <= 0:
        return 1.0
    explained = information[0, 1:] @ torch.linalg.pinv(information[1:, 1:], hermitian=True) @ information[1:, 0]
    return max(0.0, 1 - float(explained) / own)


def _chi2(fitter: Fitter, mean: torch.Tensor, deviation: torch.Tensor) -> torch.Tensor:
    """Return the mean squared distance of the fitted pixels from their DN's interval, quantisation counted as noise."""
    intervals = fitter.intervals(fitter.model.observation.bit_depth)
    outside = (intervals.low - mean).clamp(min=0) + (mean - intervals.high).clamp(min=0)
    distance = torch.where(intervals.low.isinf() | intervals.high.isinf(), outside, fitter.dn - mean)
    return (distance.square() / (deviation.square() + 1 / 12) * fitter.fitted).sum() / fitter.fitted.sum()
