"""Room at the sides of the field: which pixels count while candidates are compared.

What lies beyond the patterns may be unknown. A pixel whose value depends on it, by any of the hypotheses that are
compared, counts for none of them. Once the search has decided, every pixel counts that its result can predict.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.gap import residuals
from sci_lightning.diagnosis.fit.information_criterion import judged_by
from sci_lightning.diagnosis.model.camera_model import Hypothesis, Setting
from sci_lightning.encoder.effects.parameter import part_of


def border_for_starts(
    fitter: Fitter, hypothesis: Hypothesis, further: Mapping[str, list[Setting]] | None = None, part: float = 1.0
) -> Fitter:
    """Return a fitter that leaves out what depends on the surround for any candidate at its starts.

    Args:
        fitter: fits hypotheses to the captures.
        hypothesis: the model without the candidates.
        further: starts by effect beside those that the effect always has.
        part: of the starts' distance from doing nothing that is tried.
    """
    model, seen = fitter.model, fitter.model.observation
    return fitter.covering(
        hypothesis,
        *(
            hypothesis.with_effect(name, part_of(start, effect.about, part))
            for name, effect in model.vocabulary.items()
            if name not in hypothesis.effects and not effect.noise and not effect.map_kind
            for start in [*effect.starts(seen.frames, seen.size, seen.bit_depth), *(further or {}).get(name, [])]
        ),
    )


def with_border_for_starts(
    fitter: Fitter, base: Fit, further: Mapping[str, list[Setting]] | None = None, part: float = 1.0
) -> tuple[Fitter, Fit]:
    """Return a fitter that leaves out what depends on the surround for any candidate at its starts, and its base fit.

    Candidates are screened with that: an effect must not be judged by pixels that its formula cannot know.

    Args:
        fitter: fits hypotheses to the captures.
        base: the model without the candidates.
        further: starts by effect beside those that the effect always has.
        part: of the starts' distance from doing nothing that is tried.
    """
    wider = border_for_starts(fitter, base.hypothesis, further, part)
    return wider, judged_by(wider, base, fitter)


def with_border_for_candidates(fitter: Fitter, base: Fit, fits: dict[str, Fit]) -> tuple[Fitter, Fit, dict[str, Fit]]:
    """Return the fits of a round compared alike: none is judged by pixels that depend on the surround for another.

    Candidates here are the fits that gain at least ``SearchSettings.border_gain_share`` of what the best one gains; the
    others may have run away, and the field would be left out for nothing.
    """
    while fits:
        gains = {name: fit.log_likelihood - base.log_likelihood for name, fit in fits.items()}
        least = fitter.settings.border_gain_share * max(gains.values())
        candidates = [fit.hypothesis for name, fit in fits.items() if gains[name] >= least]
        wider = fitter.covering(base.hypothesis, *candidates)
        if wider is fitter:
            break
        fitter, base, fits = wider, wider.again(base), {name: wider.again(fit) for name, fit in fits.items()}
    return fitter, base, fits


def with_all_predictable(whole: Fitter, fitter: Fitter, fit: Fit) -> tuple[Fitter, Fit]:
    """Return a model fitted with every pixel that it can predict; the search had left out more for the sake of rivals.

    Args:
        whole: a fitter that leaves nothing out.
        fitter: the search's.
        fit: the model that it selected.
    """
    wide = whole.covering(fit.hypothesis)
    return (wide, wide.again(fit)) if wide.pixels > fitter.pixels else (fitter, fit)


def misfit_outside(wide: Fitter, fit: Fit, narrow: Fitter) -> float:
    """Return reduced chi2, of randomised quantile residuals, of the pixels that count for one fitter and not another.

    Args:
        wide: a fitter.
        fit: of it.
        narrow: the other fitter.
    """
    prediction = wide.with_map_uncertainty(fit.prediction, fit.maps)
    residual = residuals(wide, prediction, seed=0)
    outside = torch.ones(wide.model.observation.size, dtype=torch.bool)
    outside[narrow.split.window] = False
    return float(residual[:, outside[wide.split.window]].square().mean())
