"""Which effect a round of the blind search names, and what its nats count for."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.diagnosis.blind.blind_fit import BlindFit, BlindFitter
from sci_lightning.diagnosis.blind.likelihood_comparison import Comparison
from sci_lightning.diagnosis.blind.search import MUCH, BlindSearch, Contender
from sci_lightning.diagnosis.search_settings import SearchSettings
from tests.diagnosis.blind.test_likelihood import likelihood_of, snapshots


@pytest.fixture(scope="module")
def search() -> BlindSearch:
    likelihood, ideal = likelihood_of(snapshots())
    return BlindSearch(BlindFitter(likelihood), ideal, SearchSettings(), lambda message: None)


def fit_of(search: BlindSearch, name: str, value: float, spread: float = 1.0) -> BlindFit:
    """A fit of an effect whose parameters' variances are ``spread``."""
    parameters = list(search.fitter.model.effects[name].about)
    one = torch.eye(len(parameters), dtype=torch.float64)
    hypothesis = search.noise.with_effect(name, dict.fromkeys(parameters, value))
    nothing = torch.zeros(16, 4, dtype=torch.float64)
    blocks, free = torch.ones(16, dtype=torch.bool), tuple((name, parameter) for parameter in parameters)
    return BlindFit(hypothesis, nothing, blocks, free, spread * one)


def contender(search: BlindSearch, name: str, nats: float, gain: float, z: float = 9.0, agree: int = 4) -> Contender:
    return Contender(name, fit_of(search, name, 0.3), Comparison(nats, z, agree, 4), gain + 7, gain)


def test_a_likelier_substitute_is_named_in_the_place_of_a_clear_one(
    search: BlindSearch, monkeypatch: pytest.MonkeyPatch
) -> None:
    leak = contender(search, "mask_contrast", 85, 28)
    black = contender(search, "black_level", 137, -3, z=2.9)
    flicker = contender(search, "flicker", 120, -4)
    assert leak.clear and not black.clear and not flicker.clear

    substitutes: set[tuple[str, str]] = set()
    monkeypatch.setattr(search, "_supersedes", lambda other, one: (other.name, one.name) in substitutes)
    assert search._winner([leak, black, flicker]) is leak  # both others leave enough to it
    substitutes |= {("black_level", "mask_contrast"), ("flicker", "mask_contrast")}
    assert search._winner([leak, flicker]) is leak  # more parameters have to be paid for
    assert search._winner([leak, black, flicker]) is black
    assert search._winner([black]) is None and search._winner([]) is None
    fit = fit_of(search, "black_level", 0.3, spread=1000.0)
    nats = search._nats(fit, "black_level", Comparison(137, 9.0, 3, 4))
    assert nats == leak.nats  # what is clear is that one of the two is there


def test_a_few_blocks_that_tell_much(search: BlindSearch) -> None:
    far, near = fit_of(search, "mask_shift", 0.3, spread=1e-3), fit_of(search, "mask_shift", 0.3, spread=1e-2)
    assert search._nats(far, "mask_shift", Comparison(268, 2.1, 6, 8)) == MUCH
    assert search._nats(far, "mask_shift", Comparison(268, 1.9, 6, 8)) == pytest.approx(2 * 1.9**2)
    assert search._nats(far, "mask_shift", Comparison(20, 2.1, 6, 8)) == pytest.approx(2 * 2.1**2)
    assert search._nats(near, "mask_shift", Comparison(268, 2.1, 6, 8)) == pytest.approx(2 * 2.1**2)
    assert search._nats(near, "mask_shift", Comparison(268, 9.0, 8, 8)) == pytest.approx(0.5 * 2 * 0.3**2 / 1e-2)
    assert Contender("mask_shift", far, Comparison(268, 2.1, 6, 8), MUCH, 10).clear
    assert not Contender("mask_shift", far, Comparison(268, 2.1, 5, 8), MUCH, 10).clear
    assert not Contender("mask_shift", far, Comparison(20, 2.1, 6, 8), 8, 1).clear


def test_what_another_effect_makes_superfluous(search: BlindSearch) -> None:
    blocks, without_mask = search.all_blocks, {"leak": 0.9}
    ideal = search.fitter.evaluate(search.noise, blocks)
    leak = search.fitter.fit(search.noise.with_effect("mask_contrast", {"leak": 0.01}), blocks)
    assert search._is_superfluous("mask_contrast", leak, ideal, 3.0)
    faint = search.fitter.evaluate(search.noise.with_effect("mask_contrast", without_mask), blocks)
    assert not search._is_superfluous("mask_contrast", leak, faint, 3.0)
