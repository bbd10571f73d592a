"""The whole explanation: names first, then what is left; and the other way round where that looks suspicious."""

from __future__ import annotations

from collections.abc import Callable

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.camera_model import Hypothesis
from sci_lightning.diagnosis.model.noise import settle
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed, leftover, likeliest, unnamed_threshold
from sci_lightning.diagnosis.search.search import Round, prune, score, search


def explain(
    fitter: Fitter, before: Fit, noise: Hypothesis, told: Callable[[str], None]
) -> tuple[Fit, list[str], list[Round], list[Unnamed]]:
    """The likeliest model, the names in it, the rounds of the search that led there, and what has no name.

    Names are sought first. If something is left, if many names or another noise than the datasheet's were needed, the
    strongest free-form deviation is taken into the ideal model, and names are sought beside it: effects that only
    stood in for it are then not needed. The better of the two models counts, parameters priced.

    Args:
        fitter: of the captures.
        before: the ideal camera.
        noise: shot and read noise to begin with.
        told: is called with a line of text whenever there is news.
    """
    fit, rounds = search(fitter, noise, told)
    fit, unnamed = leftover(fitter, fit, before, noise, (), told)
    settled, differing = settle(fitter, fit)
    if unnamed or differing or len(fit.hypothesis.effects) - len(noise.effects) >= fitter.settings.many_effects:
        ideal = fitter.fit(noise, iterations=30)
        probe, start = likeliest(fitter, ideal, unnamed_threshold(fitter, fit, ideal, noise=ideal))
        if probe is not None and score(fitter, start) > score(fitter, ideal) + 0.5 * (fit.total - ideal.total):
            told(f"beside it: {probe.where}")
            other, more = search(fitter, start.hypothesis, told)
            substitute = fitter.settings.surrogate_fraction * (start.total - ideal.total)
            other = prune(fitter, other, start.hypothesis, substitute)
            other, rest = leftover(fitter, other, before, noise, (probe,), told)
            if score(fitter, other) > score(fitter, fit):
                fit, rounds, unnamed = other, more, rest
                settled, differing = settle(fitter, fit)
    free = {each.name for each in unnamed}
    names = [name for name in fit.hypothesis.effects if name not in noise.effects and name not in free]
    return settled, names if unnamed else names + differing, rounds, unnamed
