"""The noise at the end: what the datasheet says, unless the captures speak clearly against it."""

from __future__ import annotations

import math

from sci_lightning.diagnosis.fit.fit import Fit, Fitter, Name
from sci_lightning.diagnosis.model.camera_model import Hypothesis

START = {"shot_noise": ("full_well", 1e4), "read_noise": ("std", 1.0)}


def stated(fitter: Fitter) -> tuple[Hypothesis, tuple[Name, ...]]:
    """The datasheet's noise (a guess where it is silent), and the parameters that it states."""
    seen = fitter.model.observation
    told = {"shot_noise": seen.full_well, "read_noise": seen.read_noise}
    effects = {name: {about: told[name] or guess} for name, (about, guess) in START.items()}
    fixed = tuple((name, about) for name, (about, _) in START.items() if told[name] is not None)
    return Hypothesis({name: dict(values) for name, values in effects.items()}), fixed


def settle(fitter: Fitter, fit: Fit) -> tuple[Fit, list[str]]:
    """The fit with as much of the stated noise as the captures bear, and the noise effects that differ from it."""
    datasheet, fixed = stated(fitter)
    ways = [tuple(each for i, each in enumerate(fixed) if not chosen >> i & 1) for chosen in range(2 ** len(fixed))]
    best, differing, best_worth = fit, [name for name, _ in fixed], -float("inf")
    for kept in ways:
        start = fit.hypothesis
        for name, parameter in kept:
            start = start.having(name, {parameter: datasheet.effects[name][parameter]})
        trial = fitter.fit(start, fixed=kept, iterations=30)
        freed = [each for each in fixed if each not in kept]
        cost = len(freed) * (fitter.settings.min_gain_nats + 0.5 * math.log(fitter.use.numel()))
        if trial.total - cost > best_worth:
            best, differing, best_worth = trial, [name for name, _ in freed], trial.total - cost
    return best, differing
