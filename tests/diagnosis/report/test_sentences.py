"""The headline of a report: the verdict in one sentence."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from sci_lightning.diagnosis.diagnosis import Assessment, Diagnosis
from sci_lightning.diagnosis.fit.gap import Gap
from sci_lightning.diagnosis.report.sentences import clause, headline
from sci_lightning.diagnosis.residual_tests import ResidualTest
from sci_lightning.diagnosis.search.evidence import Estimate, NamedEffect
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed
from sci_lightning.encoder.effects import Effect, MaskShift
from tests.diagnosis.residual_tests.test_residual_test import with_p

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
        remaining=remaining,
    )


def named(name: str, **changes: Any) -> NamedEffect:
    """``SHIFT`` under another name."""
    return replace(SHIFT, effect=type("Other", (Effect,), {"name": name, "stage": "optics", "about": {}}), **changes)


def test_explained() -> None:
    assert headline(diagnosed((SHIFT,))) == (
        "The mask's image is displaced by (0.610 ± 0.002, -0.350 ± 0.002) pixel; with that in the model the held-out "
        "RMS error falls from 19.1 to 1.54 DN (chi2 168.9 to 0.981), and nothing significant is left."
    )


def test_it_begins_with_what_fell() -> None:
    """A chi2 that rises is no improvement that anybody sees; below 1 it says that the noise was overestimated."""
    before, after = replace(BEFORE, chi2=0.498, rmse_dn=5.2), replace(AFTER, chi2=1.008, rmse_dn=1.0)
    assert (
        "the held-out RMS error falls from 5.2 to 1 DN (from chi2 0.498, below 1 because the noise was overestimated, "
        "to 1.008), and"
    ) in headline(diagnosed((SHIFT,), before=before, after=after))
    noise = replace(BEFORE, rmse_dn=1.54, chi2=2.5)
    assert "the held-out misfit falls from chi2 2.500 to 0.981, and" in headline(diagnosed((SHIFT,), before=noise))
    weak = replace(BEFORE, rmse_dn=1.541, chi2=0.982, nll=1.7003)
    likelier = "held-out pixels become likelier by 6 nats (chi2 0.981), and"
    assert likelier in headline(diagnosed((SHIFT,), before=weak))
    less = replace(BEFORE, rmse_dn=1.54, chi2=0.4, nll=1.8)
    assert "likelier by 2,000 nats (from chi2 0.400, below 1" in headline(diagnosed((SHIFT,), before=less))


def test_an_alternative_is_admitted() -> None:
    sentence = headline(diagnosed((replace(SHIFT, alternatives=("mask_scale", "mine")),)))
    assert "pixel (or it is mask_scale or mine, which these captures cannot tell from it); with" in sentence
    many = tuple(named(name, alternatives=("x",)) for name in "abcd")
    assert headline(diagnosed(many)).startswith("4 effects act together: a (or x), b (or x), c (or x), d (or x); ")


def test_nothing_hidden() -> None:
    assert headline(diagnosed()) == (
        "The captures agree with the ideal camera: held-out chi2 0.981, and nothing significant is left."
    )


def test_something_is_left() -> None:
    rows = diagnosed((SHIFT,), remaining=(with_p(1e-9),))
    assert "but the residuals are not noise yet (rows)" in headline(rows)
    ghost = headline(diagnosed((SHIFT,), (GHOST,)))
    assert "but something without a name is left (in the optics, a second" in ghost
    unexplained = headline(diagnosed((), (GHOST,), after=replace(AFTER, chi2=168.93)))
    assert "(held-out chi2 168.9) and no name explains it: in the optics" in unexplained


def test_many_effects_are_listed_by_name() -> None:
    effects = tuple(named(name) for name in "abcd")
    assert headline(diagnosed(effects)).startswith("4 effects act together: a, b, c, d; ")


def test_an_effect_of_a_user_may_have_its_own_words() -> None:
    loss = {"dx": Estimate(0.2, 0.01, 2e-4, "1")}
    scratch = replace(named("scratch"), parameters=loss)
    assert clause(scratch) == "scratch (dx 0.200 ± 0.010)"
    spoken = type("Spoken", (scratch.effect,), {"sentence": "a scratch takes {dx} of the light"})
    assert headline(diagnosed((replace(scratch, effect=spoken),))).startswith("A scratch takes 0.200 ± 0.010 of the l")
