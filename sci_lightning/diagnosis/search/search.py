"""The search: add the effect that explains most, fit everything anew, and drop what is no longer needed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.camera_model import Hypothesis
from sci_lightning.diagnosis.search.rivals import rivals
from sci_lightning.diagnosis.search.screen import screen


@dataclass(frozen=True)
class Round:
    """One round of the search.

    Attributes:
        screened: nats that every candidate was expected to gain, by name.
        fitted: nats that those tried gained in a joint fit, all pixels and held-out ones, by name.
        added: the one chosen; None when none was worth its parameters.
    """

    screened: dict[str, float]
    fitted: dict[str, tuple[float, float]]
    added: str | None


def search(
    fitter: Fitter, noise: Hypothesis, told: Callable[[str], None] = lambda text: None
) -> tuple[Fit, list[Round]]:
    """Greedy forward selection with joint refits, judged on all pixels and on those held out, then pruned backwards.

    The noise is refitted every round, so that it takes up what is not explained yet and gives it back later.

    Args:
        fitter: of the captures.
        noise: shot and read noise to begin with.
        told: is called with a line of text for every effect that is added.
    """
    best = ideal = fitter.fit(noise, iterations=30)
    rounds, settings = [], fitter.settings
    for _ in range(settings.max_effects):
        trials = []
        screened = screen(fitter, best)
        for candidate in screened[: settings.candidates_fitted]:
            if candidate.gain > settings.min_gain_nats:
                start = candidate.added(fitter.model, best.hypothesis)
                trials.append((candidate.name, fitter.fit(start, iterations=20)))
        gains = {name: (fit.total - best.total, fit.held - best.held) for name, fit in trials}
        least = settings.formula_error * fitter.explained(best, ideal, best)
        trials = [(name, fit) for name, fit in trials if worth(fitter, best, fit) > least]
        name, fit = max(trials, key=lambda each: worth(fitter, best, each[1]), default=(None, best))
        rounds.append(Round({each.name: each.gain for each in screened}, gains, name))
        if name is None:
            break
        told(f"{name}: {gains[name][0]:.0f} nats")
        best = prune(fitter, fit, noise, settings.formula_error * fitter.explained(fit, ideal, fit))
    return exchange(fitter, best, noise), rounds


def exchange(fitter: Fitter, fit: Fit, noise: Hypothesis) -> Fit:
    """With a better effect in the place of each that was chosen before the others were known."""
    for name in [each for each in fit.hypothesis.effects if each not in noise.effects]:
        if name in fit.hypothesis.effects and len(fit.hypothesis.effects) - len(noise.effects) > 1:
            without = fitter.fit(fit.hypothesis.without(name))
            for _, rival in rivals(fitter, fit, without, name):
                if score(fitter, rival) > score(fitter, fit) + fitter.settings.min_gain_nats:
                    fit = rival
    return fit


def prune(fitter: Fitter, fit: Fit, noise: Hypothesis, margin: float = 0.0) -> Fit:
    """Without the effects that are not worth their parameters, and ``margin`` nats, beside the others."""
    for name in [each for each in fit.hypothesis.effects if each not in noise.effects]:
        without = fitter.fit(fit.hypothesis.without(name))
        if worth(fitter, without, fit) <= margin:
            fit = without
    return fit


def worth(fitter: Fitter, less: Fit, more: Fit) -> float:
    """Nats that the larger model gains beyond its parameters' cost (BIC); held-out pixels must speak for it."""
    if fitter.split.held.any() and more.held <= less.held:
        return -math.inf
    return score(fitter, more) - score(fitter, less) - fitter.settings.min_gain_nats


def score(fitter: Fitter, fit: Fit) -> float:
    """Nats less the cost of the parameters (BIC)."""
    return fit.total - 0.5 * parameters(fit) * math.log(fitter.use.numel())


def parameters(fit: Fit) -> int:
    """How many parameters a hypothesis has; a map counts as the one that describes it."""
    return sum(len(values) for values in fit.hypothesis.effects.values())
