"""Spurious effects: names that may only stand in for something that has no name.

Where the vocabulary lacks the true deviation, the search names the effects that come closest to it, and a free-form
deviation takes what they leave. An effect that is really there betrays itself by four properties, which a stand-in
lacks: its parameters differ from those of doing nothing, it explains a fair part of what the free-form deviations do,
the fit says the same of it with and without them, and every part of the captures says by itself that it is as strong
as the others say. (The first is no matter of course: the form of an effect's noise alone, such as that of a saturation
at full scale, may take up pixels that nothing explains.) Names that lack one of these are withdrawn, the most doubtful
first, because a stand-in beside it makes a right name look doubtful too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence

import torch
from scipy.stats import chi2

from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.information_criterion import prune
from sci_lightning.diagnosis.fit.parameters import FreeParameters
from sci_lightning.diagnosis.model.camera_model import Hypothesis
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed, quantified
from sci_lightning.encoder.effects.parameter import part_of

LIGHT_LEVELS = 12
"""Levels of light, of equally many pixels each, to which the effect is fitted one by one."""
MIN_DISTANCE_NATS = 2.0
"""Nats by which the parameters of an effect must be likelier than those of doing nothing, while the other effects stay
unchanged: two standard deviations of an effect that the others cannot imitate."""
NEARLY_NEUTRAL_SHARE = 1e-3
"""Part of the distance from their neutral values that the parameters of an effect keep which does nearly nothing."""
MIN_OWN_INFORMATION_SHARE = 1e-6
"""Part of its information that an effect must keep beside the others' parameters, or rounding is all that is left."""
PARTS_PER_SIDE = 4
"""Rows and columns of blocks that the field is divided into; the effect is fitted to each block by itself."""


def without_spurious_effects(
    fit: Fit,
    noise: Hypothesis,
    unnamed: Sequence[Unnamed],
    on_progress: Callable[[str], None] = lambda message: None,
) -> tuple[Fit, list[Unnamed]]:
    """Return the model without the names that may be spurious, and what has no name, quantified beside the others.

    Args:
        fit: the model that the search selected.
        noise: effects that stay in any case.
        unnamed: the deviations of the model that have no name.
        on_progress: called with a one-line message for every name that is withdrawn.
    """
    stay = {*noise.effects, *(deviation.name for deviation in unnamed)}
    rest, withdrawn = list(unnamed), False
    while doubts := doubts_about(fit, stay, rest):
        name, (_, why) = max(doubts.items(), key=lambda item: item[1][0])
        on_progress(f"{name} is set aside: {why}")
        fit, withdrawn = fit.without(name, iterations=20), True
        rest = [quantified(fit, one) for one in rest]
    if not withdrawn:
        return fit, rest
    fit = prune(fit, noise.effects)
    return fit, [quantified(fit, one) for one in rest if one.name in fit.hypothesis.effects]


def names_are_certain(fit: Fit, noise: Hypothesis, unnamed: Sequence[Unnamed]) -> bool:
    """Return whether a model has names, and none of them may be spurious; the arguments are as above."""
    stay = {*noise.effects, *(deviation.name for deviation in unnamed)}
    return not set(fit.hypothesis.effects) <= stay and not doubts_about(fit, stay, unnamed)


def doubts_about(fit: Fit, stay: Collection[str], unnamed: Sequence[Unnamed]) -> dict[str, tuple[float, str]]:
    """Return the names that may be spurious with how doubtful they are, 1 at the threshold, and why.

    Args:
        fit: the model.
        stay: effects that are not tested: noise, and deviations without a name.
        unnamed: those deviations.
    """
    settings, doubts = fit.fitter.settings, dict[str, tuple[float, str]]()
    names = [name for name in fit.hypothesis.effects if name not in stay]
    if not names:
        return {}
    named_only = _without(fit, unnamed) if unnamed else None
    strongest = max((deviation.nats for deviation in unnamed), default=0.0)
    for name in names:
        contribution = Contribution(fit, name)
        distance = distance_from_nothing(fit, name)
        signs = {
            "parts of the captures say different things about it": contribution.disagreement()
            / settings.name_agreement,
            "its parameters are those of doing nothing": MIN_DISTANCE_NATS / max(distance, 1e-9),
        }
        if named_only is not None:
            difference = contribution.difference(named_only.hypothesis) / settings.name_agreement
            signs["it says something else without what has no name"] = difference
            least = settings.name_share * strongest
            signs["it explains little beside what has no name"] = least / max(contribution.nats(), 1e-9)
        why, doubt = max(signs.items(), key=lambda sign: sign[1])
        if doubt > 1:
            doubts[name] = doubt, why
    return doubts


def distance_from_nothing(fit: Fit, name: str) -> float:
    """Return the nats by which the numbers of an effect are likelier than nearly neutral ones, all else unchanged.

    The effect itself stays, so that the form of its noise does not count. Infinite for maps and for effects without
    neutral numbers.
    """
    fitter = fit.fitter
    about, setting = fitter.model.effects[name].about, fit.hypothesis.effects[name]
    if name in fit.maps or not any(isinstance(one.neutral, (int, float)) for one in about.values() if not one.choices):
        return math.inf
    nothing = part_of(setting, about, NEARLY_NEUTRAL_SHARE)
    prediction = fitter.model.predict(fit.hypothesis.with_effect(name, nothing))
    loss = (fitter.log_likelihood(fit.prediction) - fitter.log_likelihood(prediction)) * fitter.fitted
    return float(loss.sum(dtype=torch.float64))


def _without(fit: Fit, unnamed: Sequence[Unnamed]) -> Fit:
    """Fit the model without what has no name; the noise keeps its values, so that it does not absorb the misfit."""
    named = fit.hypothesis
    for deviation in unnamed:
        named = named.without(deviation.name)
    effects = fit.fitter.model.effects
    fixed = tuple(
        (name, parameter) for name, setting in named.effects.items() if effects[name].noise for parameter in setting
    )
    return fit.fitter.fit(named, fixed=fixed)


class Contribution:
    """What one effect changes of the captures in a model of several.

    Args:
        fit: the model.
        name: of the effect.
    """

    def __init__(self, fit: Fit, name: str) -> None:
        fitter = fit.fitter
        self._fit, self._name = fit, name
        self._is_map = fitter.model.effects[name].map_kind is not None
        likelihood = fit.evaluated.likelihood
        self._information = (likelihood.mean_information * fitter.fitted).double()
        self._gradient = (likelihood.mean_gradient * fitter.fitted).double()
        self._neutral = fitter.model.predict(fit.hypothesis.without(name)).mean.double()
        self._change = fit.prediction.mean.double() - self._neutral

    def nats(self) -> float:
        """Return the log-likelihood that is lost without the effect, after everything else has been fitted again."""
        without = self._fit.fitter.fit(self._fit.hypothesis.without(self._name), from_afar=True)
        return self._fit.log_likelihood - without.log_likelihood

    def difference(self, other: Hypothesis) -> float:
        """Return by which part the effect would change something else with its parameters in another hypothesis."""
        hypothesis = self._fit.hypothesis.with_effect(self._name, other.effects[self._name], other.maps.get(self._name))
        change = self._fit.fitter.model.predict(hypothesis).mean.double() - self._neutral
        return float((self._squared(change - self._change) / self._squared(self._change).clamp(min=1e-30)).sqrt())

    def disagreement(self) -> float:
        """Return by which part of its strength parts of the captures disagree about the effect.

        Captures, levels of light and places are fitted in turn, each by a step of Newton's method with the parameters
        of the other effects eliminated. The result is the root mean square of these steps about their mean, weighted
        with their information and without what chance contributes; 0 where chance suffices, for a fixed-pattern map
        (its test is :func:`~sci_lightning.diagnosis.search.map_test.map_p_value`), and for an effect that the others
        can imitate.
        """
        change = self._change - self._explained_by_others()
        information, gradient = change.square() * self._information, change * self._gradient
        total, largest = information.sum(), 0.0
        if self._is_map or float(total) < MIN_OWN_INFORMATION_SHARE * float(self._squared(self._change)):
            return 0.0
        common = gradient.sum() / total
        for place, count in self._divisions():
            weight, slope = (
                torch.zeros(count, dtype=torch.float64).index_add_(0, place.flatten(), values.flatten())
                for values in (information, gradient)
            )
            known = weight > 1e-9 * total
            apart = slope[known] / weight[known] - common
            statistic, freedom = float((weight[known] * apart.square()).sum()), int(known.sum()) - 1
            if chi2.sf(statistic, freedom) < self._fit.fitter.settings.max_residual_p_value:
                largest = max(largest, (statistic - freedom) / float(total))
        return largest**0.5

    def _squared(self, change: torch.Tensor) -> torch.Tensor:
        return (change.square() * self._information).sum()

    def _explained_by_others(self) -> torch.Tensor:
        """The part of the change that the parameters of the other effects can imitate."""
        others = tuple(parameter for parameter in self._fit.free if parameter[0] != self._name)
        if not others:
            return torch.zeros_like(self._change)
        jacobian = FreeParameters(self._fit.fitter.model, others).jacobian(self._fit.hypothesis, self._fit.prediction)
        flat = jacobian.double().flatten(1)
        weighted = flat * self._information.flatten()
        inverse = torch.linalg.pinv(weighted @ flat.T, hermitian=True, rtol=1e-10)
        return (inverse @ (weighted @ self._change.flatten()) @ flat).view_as(self._change)

    def _divisions(self) -> Iterator[tuple[torch.Tensor, int]]:
        """Ways to divide the pixels ``(N, H, W)``: the number of the part of every pixel, and how many parts."""
        mean = self._fit.prediction.mean.contiguous()
        captures, height, width = mean.shape
        yield torch.arange(captures)[:, None, None].expand(mean.shape), captures
        order = mean.flatten().argsort()
        level = torch.empty_like(order)
        level[order] = torch.arange(order.numel()) * LIGHT_LEVELS // order.numel()
        yield level.view(mean.shape), LIGHT_LEVELS
        rows, columns = (torch.arange(side) * PARTS_PER_SIDE // side for side in (height, width))
        yield (rows[:, None] * PARTS_PER_SIDE + columns).expand(mean.shape), PARTS_PER_SIDE**2
