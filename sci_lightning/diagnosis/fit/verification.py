"""Verification: captures that neither fits nor choices of a model have seen are opened once, at the end.

Held-out pixels take part in every choice of the search, so that it may have chosen what happens to suit them. The
verdict of a diagnosis rests on captures that nothing has seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.gap import Gap, held_out_gap
from sci_lightning.diagnosis.fit.split import Split
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.encoder.free_form import FreeForm
from sci_lightning.errors import BadInput


@dataclass(frozen=True)
class Verification:
    """The misfit on captures that nothing has seen.

    Attributes:
        captures: their numbers in the file.
        before: gap of the ideal camera.
        after: gap of the corrected camera.
    """

    captures: tuple[int, ...]
    before: Gap
    after: Gap

    def describe(self) -> dict[str, Any]:
        """Return the verification as it stands in ``report.json``."""
        after = self.after.describe()
        return {
            **{name: after[name] for name in ("chi2", "rmse_dn", "nll", "pixels", "chi2_limit")},
            "captures": list(self.captures),
            "before": self.before.describe(),
        }


def set_aside(observation: Observation, one_in: int) -> tuple[Observation, Observation | None]:
    """Divide captures into those for fits and choices, and those for verification.

    Args:
        observation: all captures with known scenes.
        one_in: one capture of so many of each kind is set aside where the file does not choose them; 0 for none. The
            choice follows from the captures' content, not from their order in the file.

    Returns:
        both parts; the second is None where nothing is set aside.

    Raises:
        BadInput: the file sets every capture aside.
    """
    aside = observation.verification
    if aside is None:
        aside = torch.zeros(len(observation), dtype=torch.bool)
        for kind in set(observation.kinds):
            members = [n for n, other in enumerate(observation.kinds) if other == kind]
            aside[members[one_in - 1 :: one_in] if one_in else []] = True
    if not aside.any():
        return observation, None
    if aside.all():
        raise BadInput("verification: every capture with a known scene is set aside; none is left to be fitted")
    return observation.take(~aside), observation.take(aside)


def verify(fitter: Fitter, before: Fit, after: Fit, observation: Observation, seed: int) -> Verification:
    """Judge two fits by captures that they have not seen.

    Args:
        fitter: made both fits.
        before: the ideal camera.
        after: the corrected camera.
        observation: the captures set aside.
        seed: of the residuals' randomisation.
    """
    unseen = torch.zeros_like(observation.dn, dtype=torch.bool)
    nobody = torch.zeros(len(observation), dtype=torch.bool)
    split = Split(unseen, (), nobody, border=fitter.split.border)
    judge = Fitter(fitter.model.of_captures(observation), split, fitter.settings)
    estimated_from = float(fitter.fitted.sum())
    gaps = [held_out_gap(judge, transferred(judge, fit), seed, estimated_from) for fit in (before, after)]
    return Verification(tuple(sorted(observation.number.tolist())), *gaps)


def transferred(judge: Fitter, fit: Fit) -> Fit:
    """Return a fit with what it predicts for other captures.

    Free-form deviations that belong to the captures (the power of the source in each of them) are left out.
    """
    model, hypothesis = judge.model, fit.hypothesis
    for name in fit.hypothesis.effects:
        effect = model.effects[name]
        if issubclass(effect, FreeForm) and effect.of_captures:
            hypothesis = hypothesis.without(name)
    prediction = model.predict(hypothesis)
    maps = {
        name: replace(one, jacobian=model.map_jacobian(hypothesis, name, prediction)) for name, one in fit.maps.items()
    }
    return replace(fit, hypothesis=hypothesis, prediction=prediction, maps=maps)
