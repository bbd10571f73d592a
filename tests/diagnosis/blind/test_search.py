"""Which effect a round of the blind search names, and what its nats count for."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.diagnosis.blind.blind_fit import BlindFit, BlindFitter
from sci_lightning.diagnosis.blind.likelihood_comparison import Comparison
from sci_lightning.diagnosis.blind.search import BlindSearch, Contender
from sci_lightning.diagnosis.search_settings import SearchSettings
from tests.diagnosis.blind.test_likelihood import likelihood_of, snapshots


@pytest.fixture(scope="module")
def search() -> BlindSearch:
    likelihood, ideal = likelihood_of(snapshots())
    return BlindSearch(BlindFitter(likelihood), ideal, SearchSettings(), lambda message: None)


def fit_of(search: BlindSearch, name: str, value: float, spread: float = 1.0) -> BlindFit:
    """A fit of an effect with one parameter, whose variance is ``spread`` times that of independent blocks."""
    parameter = next(iter(search.fitter.model.effects[name].about))
    one = torch.ones(1, 1, dtype=torch.float64)
    hypothesis = search.noise.with_effect(name, {parameter: value})
    nothing = torch.zeros(16, 4, dtype=torch.float64)
    blocks = torch.ones(16, dtype=torch.bool)
    return BlindFit(hypothesis, nothing, blocks, ((name, parameter),), spread * one, one)


def contender(search: BlindSearch, name: str, nats: float, gain: float, z: float = 9.0, agree: int = 4) -> Contender:
    return Contender(name, fit_of(search, name, 0.3), Comparison(nats, z, agree, 4), gain + 7, gain)


def test_nats_are_adjusted_for_what_snapshots_disagree_about(search: BlindSearch) -> None:
    fitter = search.fitter
    assert fitter.adjusted(fit_of(search, "mask_blur", 0.5), "mask_blur", 40.0) == pytest.approx(40)
    assert fitter.adjusted(fit_of(search, "mask_blur", 0.5, spread=4.0), "mask_blur", 40.0) == pytest.approx(10)
    a_choice = search.noise.with_effect("mask_orientation", {"orientation": "rotated_180"})
    free: BlindFit = BlindFit(a_choice, torch.zeros(16, 4), torch.ones(16, dtype=torch.bool))
    assert fitter.adjusted(free, "mask_orientation", 40.0) == 40


def test_a_likelier_substitute_is_named_in_the_place_of_a_clear_one(
    search: BlindSearch, monkeypatch: pytest.MonkeyPatch
) -> None:
    leak = contender(search, "mask_contrast", 85, 28)
    black = contender(search, "black_level", 137, 7, z=2.9)
    delay = contender(search, "sync_offset", 120, -4)
    assert leak.clear and not black.clear and not delay.clear

    substitutes: set[tuple[str, str]] = set()
    monkeypatch.setattr(search, "_supersedes", lambda other, one: (other.name, one.name) in substitutes)
    assert search._winner([leak, black, delay]) is leak  # both others leave enough to it
    substitutes.add(("black_level", "mask_contrast"))
    assert search._winner([leak, black]) is black
    substitutes = {("sync_offset", "mask_contrast")}
    assert search._winner([leak, delay]) is None  # the likelier of the two is not sure enough
    other = contender(search, "mask_rotation", 30, 12)
    assert search._winner([leak, other, delay]) is other
    assert search._winner([black]) is None and search._winner([]) is None


def test_what_another_effect_makes_superfluous(search: BlindSearch) -> None:
    blocks, without_mask = search.all_blocks, {"leak": 0.9}
    ideal = search.fitter.evaluate(search.noise, blocks)
    leak = search.fitter.fit(search.noise.with_effect("mask_contrast", {"leak": 0.01}), blocks)
    assert search._is_superfluous("mask_contrast", leak, ideal, 3.0)
    faint = search.fitter.evaluate(search.noise.with_effect("mask_contrast", without_mask), blocks)
    assert not search._is_superfluous("mask_contrast", leak, faint, 3.0)
