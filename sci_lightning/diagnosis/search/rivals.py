"""Effects that might stand in the place of one that was found."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.linear import Linear
from sci_lightning.diagnosis.search.screen import nearer


def rivals(fitter: Fitter, fit: Fit, without: Fit, name: str) -> list[tuple[str, Fit]]:
    """Fits with another effect in the place of one, for those that may explain nearly as much.

    Which may is told by the information that the captures hold about everything in the model, the effect and the other
    together: the part of the effect's evidence that is left once the other stands in for it.

    Args:
        fitter: of the captures.
        fit: with the effect.
        without: the best fit without it.
        name: of the effect.
    """
    model, settings = fitter.model, fitter.settings
    if model.known[name].noise or any(about.choices for about in model.known[name].about.values()):
        return []
    linear = Linear(fitter, without)
    found = fit.prediction.mean - without.prediction.mean
    evidence = fit.total - without.total
    close = []
    for other, effect in model.vocabulary.items():
        if other in fit.hypothesis.effects or effect.noise or effect.map_kind:
            continue
        starts = model.starts(other, without.hypothesis)[: settings.rival_starts]
        trials = [model.predict(model.adding(without.hypothesis, other, start)) for start in starts]
        if not trials or any(trial.bits != without.prediction.bits for trial in trials):
            continue
        changes = torch.stack([found, *(trial.mean - without.prediction.mean for trial in trials)])
        information = linear.gain(changes).information
        left = _unexplained(information)
        if left < max(settings.rival_fraction, settings.rival_nats / max(evidence, 1.0)):
            size = information.diagonal()[1:].clamp(min=1e-9)
            best = int((information[0, 1:].square() / size).argmax())
            share = min(max(float(information[0, 1 + best] / size[best]), 1e-3), 1.0)
            close.append((left, other, nearer(starts[best], effect.about, share)))
    return [
        (other, fitter.fit(model.adding(without.hypothesis, other, start), iterations=20))
        for _, other, start in sorted(close, key=lambda each: each[0])[: settings.rivals_fitted]
    ]


def _unexplained(information: torch.Tensor) -> float:
    """Part of the first change that no combination of the others makes up."""
    own = float(information[0, 0])
    if own <= 0:
        return 1.0
    explained = information[0, 1:] @ torch.linalg.pinv(information[1:, 1:], hermitian=True) @ information[1:, 0]
    return max(0.0, 1 - float(explained) / own)
