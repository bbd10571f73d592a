"""Remaining misfit: drop effects whose fitted map contradicts their definition, then localise what no effect explains.

Free-form deviations (:mod:`sci_lightning.encoder.free_form`) say in which stage of the camera something is missing, not
what. They are screened like effects; of their many numbers only those that differ clearly from 0 are fitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from scipy.stats import chi2

from sci_lightning.diagnosis.fit.budget import SEARCH_SHARE
from sci_lightning.diagnosis.fit.cluster_errors import map_dispersion
from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.information_criterion import bic, bic_penalty, prune, with_common_pixels
from sci_lightning.diagnosis.fit.local_gain import LocalGain
from sci_lightning.diagnosis.fit.parameters import FreeParameters
from sci_lightning.diagnosis.fit.split import NO_BORDER
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.diagnosis.model.smooth_map import estimate_map
from sci_lightning.diagnosis.search.map_test import map_p_value
from sci_lightning.diagnosis.search.probability import evidence_for, probability_of
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.free_form import FreeForm

FIRST_FREE_FORM_SHARE = 0.85
"""Part of the budget after which nothing without a name is looked for; residual tests still say that it is there."""
PROBE_MIN_SIGMA = 3.5
"""Standard deviations from 0 from which a free form keeps one of its numbers; of 250 numbers chance keeps 0.1."""
PROBE_MAX_NUMBERS = 24
"""Numbers that a free form keeps, the clearest; it bounds the run time."""
PROBE_MAX_DERIVATIVES = 250_000_000
"""Derivatives held in memory at once, 4 bytes each; larger free forms are left out."""
PROBES_FITTED = 3
"""Free forms per round that are fitted jointly after screening, as ``SearchSettings.candidates_fitted``."""
MIN_PLACE_NATS = 100.0
"""Gain from which a free form says where to look although it is improbable."""
MAX_MAP_P_VALUE = 1e-4
"""p-value below which an estimated map contradicts the definition of its effect (independent Gaussian values)."""


@dataclass(frozen=True)
class Unnamed:
    """A deviation that no effect of the vocabulary explains.

    Attributes:
        name: of the free-form deviation that shows it.
        stage: modulator, relay, exposure, optics or sensor.
        where: what it may be, in words.
        p_value: probability of so large a gain by chance, corrected for the number of deviations that were tried.
        nats: gain in log-likelihood by the free-form deviation.
        picture: ``(H, W)`` RMS change of the signal by it, DN; NaN for pixels that do not count.
        probability: that it is there, given the captures; None of a map that is not what its name says.
    """

    name: str
    stage: str
    where: str
    p_value: float
    nats: float
    picture: torch.Tensor
    probability: float | None = None


@dataclass(frozen=True)
class FreeFormCandidate:
    """A free-form deviation that the captures ask for.

    Attributes:
        name: of the deviation.
        gain: gain in log-likelihood, nats, to second order.
        numbers: how many of its numbers are not 0.
        p_value: probability of so large a gain by chance, corrected for the number of deviations that were tried.
        start: setting from which a fit should start.
        effect: its class.
        log_odds: natural logarithm of the odds that it is there, once it has been fitted.
    """

    name: str
    gain: float
    numbers: int
    p_value: float
    start: Setting
    effect: type[Effect]
    log_odds: float = 0.0

    @property
    def where(self) -> str:
        """What it may be, in words."""
        return getattr(self.effect, "where", f"the map of {self.name} has a structure that the name does not promise")

    @property
    def choice_penalty(self) -> float:
        """Nats that it costs to say which of its numbers are not 0: the logarithm of the number of choices."""
        count = getattr(self.effect, "count", self.numbers)
        return math.lgamma(count + 1) - math.lgamma(self.numbers + 1) - math.lgamma(count - self.numbers + 1)

    def bic_gain(self, pixels: float) -> float:
        """Return the expected gain beyond the penalty for the numbers and for their choice, in nats."""
        return self.gain - bic_penalty(self.numbers, pixels) - self.choice_penalty

    def added(self, fitter: Fitter, hypothesis: Hypothesis) -> Hypothesis:
        """Return the hypothesis with the deviation at its start."""
        return hypothesis.with_effect(self.name, self.start, fitter.model.zero_map(self.name))


def explain_remaining_misfit(
    fit: Fit,
    keep: Collection[str],
    given: Sequence[FreeFormCandidate] = (),
    on_progress: Callable[[str], None] = lambda message: None,
) -> tuple[Fit, list[Unnamed]]:
    """Explain what named effects leave by free-form deviations, and drop the names that this makes superfluous.

    Args:
        fit: the model with every effect that could be named.
        keep: effects that stay in any case.
        given: free-form deviations that are in the model already.
        on_progress: called with a one-line message for every deviation that is added.

    Returns:
        the model, fitted on the pixels that it can predict, and what it contains without a name.
    """
    settings, effects = fit.fitter.settings, fit.fitter.model.effects
    contradicted = contradicted_maps(fit)
    given_names = {deviation.name for deviation in given}
    as_free_form = {name: effects[name] for name in contradicted if name not in given_names}
    for name in as_free_form:
        on_progress(f"{name} is set aside: its map is not random")
        fit = fit.without(name, iterations=20)
    deviations = [*given]
    for _ in range(settings.max_unnamed - len(deviations)):
        if deviations and not fit.fitter.budget.allows("further deviations without a name"):
            break
        fit, best, larger = best_free_form(fit, as_free_form)
        if best is None:
            break
        on_progress(f"unnamed: {best.where}")
        fit = prune(larger, {*keep, best.name})
        deviations = [one for one in (*deviations, best) if one.name in fit.hypothesis.effects]
    if as_free_form and not deviations:  # what was worth a name that it does not deserve has none
        fit, best, larger = best_free_form(fit, as_free_form, only_maps=True)
        if best is not None:
            on_progress(f"unnamed: {best.where}")
            fit, deviations = larger, [best]
    # in the order of the light: a fault of the mirrors also shows as a gain of the pixels behind them
    deviations.sort(key=lambda deviation: deviation.effect.rank)
    return fit, [_unnamed(fit, deviation, contradicted) for deviation in deviations]


def contradicted_maps(fit: Fit) -> dict[str, float]:
    """Return the maps of the camera that are not what their effects say, with their p-values."""
    p_values = {
        name: map_p_value(one, map_dispersion(fit, one)[0], fit.in_laboratory)
        for name, one in fit.maps.items()
        if not one.of_captures
    }
    return {name: p_value for name, p_value in p_values.items() if p_value < MAX_MAP_P_VALUE}


def best_free_form(
    fit: Fit, maps: Mapping[str, type[Effect]] | None = None, only_maps: bool = False
) -> tuple[Fit, FreeFormCandidate | None, Fit]:
    """Find the free-form deviation that gains most in a joint fit, among those that are more probable than not.

    Args:
        fit: the model without it.
        maps: effects of the vocabulary whose maps may serve as free forms too.
        only_maps: whether these are the only ones.

    Returns:
        the model without the deviation, the deviation, and the model with it, both fitted on the pixels that both can
        predict; the model as it was and None if none is more probable than not.
    """
    fitter, pixels = fit.fitter, float(fit.fitter.pixels)
    screened = screen_free_forms(fit, maps or {}, only_maps)
    promising = [one for one in screened if one.bic_gain(pixels) > 0]
    best: tuple[Fit, FreeFormCandidate | None, Fit] = (fit, None, fit)
    largest = 0.0
    for deviation in promising[:PROBES_FITTED]:
        if not fitter.budget.allows(deviation.where, share=FIRST_FREE_FORM_SHARE if best[1] is None else SEARCH_SHARE):
            break
        start = deviation.added(fitter, fit.hypothesis)
        smaller = fitter.covering(start).repeated(fit)
        larger = smaller.fitter.fit(start, iterations=15, from_afar=True)
        smaller, larger = with_common_pixels(smaller, larger)
        gain = bic(larger) - bic(smaller) - deviation.choice_penalty
        if gain <= largest:
            continue
        log_odds = evidence_for(larger, deviation.name, without=smaller).log_odds - deviation.choice_penalty
        if log_odds > 0:  # the smaller model may have gained by further iterations alone
            log_odds = evidence_for(larger, deviation.name).log_odds - deviation.choice_penalty
        if log_odds > 0:
            best, largest = (smaller, replace(deviation, log_odds=log_odds), larger), gain
    return best


def likeliest_place(fit: Fit) -> tuple[Fit, list[Unnamed]]:
    """Add the free form that describes most of what a model leaves, however improbable it is that this is all.

    Where something is left that no free form describes well, clusters of pixels disagree about every one of them. The
    one that gains most still says where to look.

    Args:
        fit: a model that misses something.

    Returns:
        the model with it, and the free form; the model as it was and nothing if none gains ``MIN_PLACE_NATS``.
    """
    pixels, most = float(fit.fitter.pixels), MIN_PLACE_NATS
    best: tuple[Fit, list[Unnamed]] = (fit, [])
    for deviation in screen_free_forms(fit, {})[:PROBES_FITTED]:
        start = deviation.added(fit.fitter, fit.hypothesis)
        smaller = fit.fitter.covering(start).repeated(fit)
        larger = smaller.fitter.fit(start, iterations=15, fixed=fit.fixed, from_afar=True)
        gain = replace(deviation, gain=larger.log_likelihood - smaller.log_likelihood).bic_gain(pixels)
        if gain > most:
            odds = evidence_for(larger, deviation.name, without=smaller).log_odds - deviation.choice_penalty
            best, most = (larger, [_unnamed(larger, replace(deviation, log_odds=odds), {})]), gain
    return best


def screen_free_forms(base: Fit, maps: Mapping[str, type[Effect]], only_maps: bool = False) -> list[FreeFormCandidate]:
    """Estimate the gain of every free-form deviation that the model lacks; the most valuable comes first.

    Args:
        base: the fitted model.
        maps: effects of the vocabulary whose maps may serve as free forms too.
        only_maps: whether these are the only ones.
    """
    fitter, local = base.fitter, LocalGain(base)
    light = fitter.model.inside(NO_BORDER).predict(base.hypothesis).mean
    fields = light, fitter.model.whole(local.gradient), fitter.model.whole(local.information)
    free_forms = [] if only_maps else fitter.model.free_forms
    tried = [*free_forms, *(name for name in maps if name not in fitter.model.free_forms)]
    significant, others = [], fitter.maps(local.at)
    for name in tried:
        effect = fitter.model.effects[name]
        if name in base.hypothesis.effects:
            continue
        if effect.map_kind:
            one = estimate_map(fitter.model, local.at, name, fitter.fitted, others)
            p_value = float(chi2.sf(2 * max(one.evidence, 0.0), 1))
            significant.append(
                FreeFormCandidate(name, one.evidence, 1, p_value, dict.fromkeys(effect.about, one.std), effect)
            )
        elif issubclass(effect, FreeForm):
            groups = effect.proposals(*fields)
            deviation = _screen_proposals(effect, local, groups) if groups else _screen_numbers(effect, local)
            if deviation is not None:
                significant.append(deviation)
    significant = [replace(deviation, p_value=min(1.0, deviation.p_value * len(tried))) for deviation in significant]
    pixels = float(fitter.fitted.sum())
    return sorted(significant, key=lambda deviation: -deviation.bic_gain(pixels))


def _screen_numbers(effect: type[FreeForm], local: LocalGain) -> FreeFormCandidate | None:
    """Estimate the gain of a deviation with the numbers that differ clearly from 0; None if there are none."""
    fitter, at, count = local.fitter, local.at, effect.count
    if not 0 < count * fitter.fitted.numel() <= PROBE_MAX_DERIVATIVES:
        return None
    hypothesis = at.hypothesis.with_effect(effect.name, dict.fromkeys(effect.about, 0.0))
    numbers = FreeParameters(fitter.model, tuple((effect.name, number) for number in effect.about))
    gain = local.joint_gain(numbers.jacobian(hypothesis, at.prediction))
    sigmas = (gain.factors.abs() / gain.deviations).nan_to_num()
    determined = int((gain.deviations.isfinite()).sum())
    clear = (sigmas > PROBE_MIN_SIGMA).nonzero()[:, 0]
    if not len(clear):
        return None
    most = min(len(clear), PROBE_MAX_NUMBERS)
    kept = sigmas.argsort(descending=True)[:most].sort().values
    p_value = float(chi2.sf(2 * max(gain.nats, 0.0), max(determined, 1)))
    kept_gain = gain.of(kept)
    bounded = kept_gain.factors.clamp(effect.number.low, effect.number.high).tolist()
    start: Setting = {f"c{index}": value for index, value in zip(kept.tolist(), bounded, strict=True)}
    return FreeFormCandidate(effect.name, kept_gain.nats, len(kept), p_value, start, effect)


def _screen_proposals(
    effect: type[FreeForm], local: LocalGain, groups: list[list[Setting]]
) -> FreeFormCandidate | None:
    """Estimate the gain of a deviation that is not linear in its numbers, at the settings that it proposes itself."""
    model, at, best = local.fitter.model, local.at, None
    for settings in groups:
        means = [model.predict(at.hypothesis.with_effect(effect.name, setting)).mean for setting in settings]
        nats, factors = local.gain_of_single_changes(torch.stack(means) - at.prediction.mean)
        top = int(nats.argmax())
        if best is None or float(nats[top]) > best.gain:
            places = math.prod(model.observation.size)  # a proposal is the best of as many as there are pixels
            p_value = min(1.0, places * float(chi2.sf(2 * float(nats[top]), 1)))
            start = effect.scaled(settings[top], float(factors[top]))
            best = FreeFormCandidate(effect.name, float(nats[top]), len(start), p_value, start, effect)
    return best


def quantified(fit: Fit, deviation: Unnamed) -> Unnamed:
    """Return a deviation with its nats and its picture in a model, by a fit without it."""
    without = fit.without(deviation.name, iterations=8)
    rows, columns = fit.fitter.split.window
    change = torch.full(fit.fitter.model.observation.size, torch.nan)
    change[rows, columns] = (fit.prediction.mean - without.prediction.mean).square().mean(0).sqrt()
    return replace(deviation, nats=fit.log_likelihood - without.log_likelihood, picture=change)


def _unnamed(fit: Fit, deviation: FreeFormCandidate, contradicted: Mapping[str, float]) -> Unnamed:
    p_value = min(deviation.p_value, contradicted.get(deviation.name, 1.0))
    nothing = torch.full(fit.fitter.model.observation.size, torch.nan)
    probability = None if deviation.name in contradicted else probability_of(deviation.log_odds)
    one = Unnamed(deviation.name, deviation.effect.stage, deviation.where, p_value, 0.0, nothing, probability)
    return quantified(fit, one)
