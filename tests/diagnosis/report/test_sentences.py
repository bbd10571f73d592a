"""The headline of a report: the verdict in one sentence."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from sci_lightning.diagnosis.report.sentences import NOTHING_LEFT, clause, headline
from sci_lightning.diagnosis.search.evidence import Estimate, NamedEffect
from sci_lightning.encoder.effects import Effect
from tests.diagnosis.small_diagnosis import AFTER, BEFORE, GHOST, SHIFT, diagnosed, with_p


def named(name: str, **changes: Any) -> NamedEffect:
    """``SHIFT`` under another name."""
    return replace(SHIFT, effect=type("Other", (Effect,), {"name": name, "stage": "optics", "about": {}}), **changes)


def test_explained() -> None:
    sentence = headline(diagnosed((SHIFT,)))
    assert "The mask's image is displaced by (0.6100 ± 0.0021, -0.3500 ± 0.0019) pixel; " in sentence
    assert "from 19.1 to 1.54 DN (chi2 168.9 to 0.981)" in sentence and sentence.endswith(f"{NOTHING_LEFT}.")


def test_it_begins_with_what_fell() -> None:
    """A chi2 that rises is no improvement that anybody sees; below 1 it says that the noise was overestimated."""
    before, after = replace(BEFORE, chi2=0.498, rmse_dn=5.2), replace(AFTER, chi2=1.008, rmse_dn=1.0)
    fell = r"RMS error falls from 5\.2 to 1 DN \(from chi2 0\.498, below 1 .*noise.* to 1\.008\)"
    assert re.search(fell, headline(diagnosed((SHIFT,), before=before, after=after)))
    noise = replace(BEFORE, rmse_dn=1.54, chi2=2.5)
    assert "misfit falls from chi2 2.500 to 0.981" in headline(diagnosed((SHIFT,), before=noise))
    weak = replace(BEFORE, rmse_dn=1.541, chi2=0.982, nll=1.7003)
    likelier = "likelier by 6 nats (chi2 0.981)"
    assert likelier in headline(diagnosed((SHIFT,), before=weak))
    less = replace(BEFORE, rmse_dn=1.54, chi2=0.4, nll=1.8)
    assert "likelier by 2,000 nats (from chi2 0.400, below 1" in headline(diagnosed((SHIFT,), before=less))


def test_an_alternative_is_admitted() -> None:
    sentence = headline(diagnosed((replace(SHIFT, alternatives=("mask_scale", "mine")),)))
    assert "(or it is mask_scale or mine, " in sentence
    many = tuple(named(name, alternatives=("x",)) for name in "abcd")
    assert headline(diagnosed(many)).startswith("4 effects act together: a (or x), b (or x), c (or x), d (or x); ")


def test_nothing_hidden() -> None:
    sentence = headline(diagnosed())
    assert "agree with the ideal camera: held-out chi2 0.981" in sentence and sentence.endswith(f"{NOTHING_LEFT}.")


def test_something_is_left() -> None:
    rows = diagnosed((SHIFT,), remaining=(with_p(1e-9),))
    assert "but the residuals are not noise yet (rows)" in headline(rows)
    ghost = headline(diagnosed((SHIFT,), (GHOST,)))
    assert "without a name is left (in the optics, a second" in ghost
    improbable = replace(GHOST, probability=0.1)
    assert "without a name is left (perhaps in the optics, a second" in headline(diagnosed((SHIFT,), (improbable,)))
    unexplained = headline(diagnosed((), (GHOST,), after=replace(AFTER, chi2=168.93)))
    assert "(held-out chi2 168.9) and no name explains it" in unexplained


def test_many_effects_are_listed_by_name() -> None:
    effects = tuple(named(name) for name in "abcd")
    assert headline(diagnosed(effects)).startswith("4 effects act together: a, b, c, d; ")


def test_an_effect_of_a_user_may_have_its_own_words() -> None:
    loss = {"dx": Estimate(0.2, 0.01, 2e-4, "1")}
    scratch = replace(named("scratch"), parameters=loss)
    assert clause(scratch) == "scratch (dx 0.200 ± 0.010)"
    spoken = type("Spoken", (scratch.effect,), {"sentence": "a scratch takes {dx} of the light"})
    assert headline(diagnosed((replace(scratch, effect=spoken),))).startswith("A scratch takes 0.200 ± 0.010 of the l")
