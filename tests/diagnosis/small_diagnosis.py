"""A diagnosis with nothing in it but what its headline reads."""

from __future__ import annotations

from typing import Any

import torch

from sci_lightning.diagnosis.diagnosis import Assessment, Diagnosis
from sci_lightning.diagnosis.fit.budget import Budget
from sci_lightning.diagnosis.fit.gap import Gap
from sci_lightning.diagnosis.residual_tests import Picture, ResidualTest
from sci_lightning.diagnosis.search.evidence import Estimate, NamedEffect
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed
from sci_lightning.encoder.effects import MaskShift


def with_p(p_value: float) -> ResidualTest:
    return ResidualTest("rows", "mean", "?", 1.0, p_value, 0.0, p_value, Picture("curve", torch.zeros(3)))


SHIFT = NamedEffect(
    MaskShift,
    {"dx": Estimate(0.61, 0.0021, 6.1e-4, "pixel"), "dy": Estimate(-0.35, 0.0019, 3.5e-4, "pixel")},
)

GHOST = Unnamed("ghost", "optics", "a second image lies beside the first", 1e-20, 99.0, torch.zeros(2, 2))

BEFORE = Gap(chi2=168.93, rmse_dn=19.1, nll=80.0, pixels=20000, chi2_limit=1.05)

AFTER = Gap(chi2=0.981, rmse_dn=1.54, nll=1.7, pixels=20000, chi2_limit=1.05)


def diagnosed(
    effects: tuple[NamedEffect, ...] = (),
    unnamed: tuple[Unnamed, ...] = (),
    remaining: tuple[ResidualTest, ...] = (),
    before: Gap = BEFORE,
    after: Gap = AFTER,
) -> Diagnosis:
    """A diagnosis with nothing in it but what the headline reads."""
    nothing: Any = None
    return Diagnosis(
        observation=nothing,
        model=nothing,
        split=nothing,
        settings=nothing,
        seed=0,
        before=Assessment(nothing, before, nothing, ()),
        after=Assessment(nothing, after, nothing, ()),
        effects=effects,
        considered={},
        unnamed=unnamed,
        rounds=(),
        stated_noise=(),
        correlation=nothing,
        budget=Budget(120),
        remaining=remaining,
    )
