"""Which effect a round of the blind search names, and what its nats count for."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from sci_lightning.diagnosis.blind.blind_fit import BlindFit, BlindFitter, price
from sci_lightning.diagnosis.blind.candidate_comparison import (
    AMPLE_NATS,
    CandidateAssessor,
    FittedCandidate,
    LikelihoodComparison,
    compare,
)
from sci_lightning.diagnosis.blind.screening import ScreenedCandidate, _gain
from sci_lightning.diagnosis.blind.search import BlindSearch
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.search_settings import SearchSettings
from tests.diagnosis.blind.smooth_scenes import likelihood_of, snapshots


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


def candidate(search: BlindSearch, name: str, comparison: LikelihoodComparison) -> FittedCandidate:
    return FittedCandidate(name, fit_of(search, name, 0.3), comparison, 32, 25, search.assessor.is_like_a_scene(name))


def test_snapshots_must_agree_about_what_looks_like_another_scene(search: BlindSearch) -> None:
    """Six of eight snapshots are enough for the modulator; of what looks like a scene the others must mind little."""
    outvoted, halves = LikelihoodComparison(220, 4.3, 6, 8, 0.020), LikelihoodComparison(230, 4.3, 6, 8, 0.074)
    assert candidate(search, "mask_shift", halves).clear
    for name in ("black_level", "optical_blur", "flicker"):
        assert candidate(search, name, outvoted).clear
        assert not candidate(search, name, halves).clear
        assert candidate(search, name, LikelihoodComparison(220, 4.3, 3, 3, 0.125)).clear  # few have to be unanimous
        assert not candidate(search, name, LikelihoodComparison(220, 4.3, 3, 4, 0.125)).clear
        for number in (1, 2):  # one or two scenes do not tell the camera from themselves
            assert not candidate(search, name, LikelihoodComparison(220, 4.3, number, number, 0.5**number)).clear


def test_snapshots_are_compared_by_their_signed_ranks() -> None:
    """Two snapshots of eight that mind little are outvoted; the same number that mind much are not."""
    asked = torch.tensor([30.0, 20.0, 30.0, 40.0, 20.0, 30.0, -1.0, -2.0])
    minding = torch.tensor([30.0, 20.0, 30.0, 40.0, 20.0, 30.0, -41.0, -45.0])
    few, many = (compare(nats.expand(4, -1).double(), torch.zeros(4, 8), columns=2) for nats in (asked, minding))
    assert (few.agree, many.agree) == (6, 6)
    assert few.p_snapshots < 0.05 < many.p_snapshots


def test_the_likelier_of_two_is_named(search: BlindSearch, monkeypatch: pytest.MonkeyPatch) -> None:
    """A clear leak of the mask gives way to a likelier black level that has some support and leaves nothing to it."""
    leak = candidate(search, "mask_contrast", LikelihoodComparison(43, 3.4, 8, 8, 0.004))
    black = candidate(search, "black_level", LikelihoodComparison(94, 2.8, 7, 8, 0.008))
    shutter = candidate(search, "rolling_shutter", LikelihoodComparison(200, 2.5, 6, 8, 0.125))
    assert leak.clear and black.supported and not black.clear and not shutter.supported

    superseded: set[str] = set()
    monkeypatch.setattr(search, "_replaces", lambda other, one: one.name in superseded)
    assert search._winner([leak, black, shutter]) is leak  # both others leave enough to it
    superseded.add("mask_contrast")
    assert search._winner([leak, black, shutter]) is black
    assert search._winner([black, shutter]) is None and search._winner([]) is None


def test_more_parameters_have_to_be_paid_for(search: BlindSearch) -> None:
    """Three nats more are not worth a third parameter, ten are."""

    def fitted(name: str, nats: float) -> FittedCandidate:
        one = candidate(search, name, LikelihoodComparison(nats, 4.0, 4, 4, 0.0625))
        return replace(one, fit=replace(one.fit, log_likelihood=torch.full((16, 4), nats / 64, dtype=torch.float64)))

    shift, flicker = fitted("mask_shift", 409), fitted("flicker", 412)
    assert search._winner([shift, flicker]) is shift and search._winner([flicker, shift]) is shift
    flicker = fitted("flicker", 419)
    assert search._winner([shift, flicker]) is flicker and search._winner([flicker, shift]) is flicker


def test_what_supersedes_another_effect(search: BlindSearch) -> None:
    """The true leak of a mask leaves nothing to another strength of it, and is not superseded by nothing at all."""
    blocks = search.all_blocks

    def fitted(leak: float) -> FittedCandidate:
        fit = search.fitter.evaluate(search.noise.with_effect("mask_contrast", {"leak": leak}), blocks)
        return FittedCandidate("mask_contrast", fit, LikelihoodComparison(1, 9.0, 4, 4), 9, 9)

    assert search._replaces(fitted(0.0), fitted(0.3)) and not search._replaces(fitted(0.3), fitted(0.0))


def test_few_blocks_may_tell_much_about_the_mask(search: BlindSearch) -> None:
    """A displacement behind a wide blur, of which few blocks are left, is named; a black level is not."""
    comparison, spread = LikelihoodComparison(268, 2.1, 6, 8, 0.074), 1e-4
    far, black = fit_of(search, "mask_shift", 0.3, spread), fit_of(search, "black_level", 0.3, spread)
    assert search.assessor.nats(far, "mask_shift", comparison) == AMPLE_NATS
    assert FittedCandidate("mask_shift", far, comparison, AMPLE_NATS, 88).clear
    for few in (LikelihoodComparison(99, 2.1, 6, 8, 0.074), LikelihoodComparison(268, 1.9, 6, 8, 0.074)):
        assert search.assessor.nats(far, "mask_shift", few) == pytest.approx(few.calibrated)
    assert search.assessor.nats(black, "black_level", comparison) == pytest.approx(comparison.calibrated)
    near = fit_of(search, "mask_shift", 0.3, spread=1e-2)
    assert search.assessor.nats(near, "mask_shift", comparison) == pytest.approx(0.5 * 2 * 0.3**2 / 1e-2)


def test_a_candidate_that_cannot_pay_is_not_fitted(search: BlindSearch, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four times as many blocks are fitted as screened; three parameters cost a dozen nats."""
    screened = {"mask_shift": 5.0, "flicker": 1.0, "mask_contrast": 1.0}
    starts = {name: dict.fromkeys(search.fitter.model.effects[name].about, 0.1) for name in screened}
    found = [ScreenedCandidate(name, nats, starts[name], promising=True) for name, nats in screened.items()]
    monkeypatch.setattr(search.screener, "screen", lambda *_: found)
    monkeypatch.setattr(
        search,
        "_fitted_candidate",
        lambda base, name, *_: candidate(search, name, LikelihoodComparison(9.0, 9.0, 4, 4)),
    )
    base = search.fitter.evaluate(search.noise, search.fitted_blocks)
    fitted = {one.name for one in search._fitted(base, count=3, starts=1)}
    assert fitted == {"mask_shift", "mask_contrast"}


def test_what_cannot_catch_up_is_fitted_no_further(search: BlindSearch, monkeypatch: pytest.MonkeyPatch) -> None:
    fitter, evaluated = search.fitter, []
    evaluate = fitter.evaluate
    monkeypatch.setattr(fitter, "evaluate", lambda *given: evaluated.append(1) or evaluate(*given))
    start = search.noise.with_effect("mask_shift", {"dx": 0.3, "dy": 0.2})

    def fitted(more: float) -> tuple[float, int]:
        evaluated.clear()
        fit = fitter.fit(start, search.fitted_blocks, ahead=evaluate(start, search.fitted_blocks).log_likelihood + more)
        return fit.nats, len(evaluated)

    (whole, many), (part, few) = fitted(0.0), fitted(1e6)
    assert evaluate(start, search.fitted_blocks).nats < part < whole and few == 2 < many


def test_when_two_effects_are_distinguished(search: BlindSearch) -> None:
    """By many blocks that agree, or by few that tell much; a rival that is next to as likely is an alternative."""
    assert search._is_distinguished(LikelihoodComparison(40, 3.5, 8, 8)) and search._is_distinguished(
        LikelihoodComparison(774, 2.9, 8, 8)
    )
    for alike in (
        LikelihoodComparison(40, 2.9, 8, 8),
        LikelihoodComparison(774, 1.9, 8, 8),
        LikelihoodComparison(1, 3.5, 8, 8),
    ):
        assert not search._is_distinguished(alike)


def test_an_effect_that_lost_its_support_is_dropped(search: BlindSearch, monkeypatch: pytest.MonkeyPatch) -> None:
    """A black level that stood in for a displacement goes if only half of the snapshots ask for it beside that.

    It also goes if it is above what was recorded in the darkest pixels.
    """
    whole = fit_of(search, "black_level", 0.3, spread=1e-4)
    whole = replace(whole, hypothesis=whole.hypothesis.with_effect("mask_shift", {"dx": 1.0, "dy": 0.0}))
    stated = replace(search.fitter.model.observation, read_noise=1.0)
    monkeypatch.setattr(search.fitter.model, "observation", stated)
    nats = torch.full((16, 4), 50.0, dtype=torch.float64)
    all_ask, half_ask = [1.0, 1.0, 1.0, 1.0], [1.0, 1.0, -0.2, -0.2]
    for asked, below, kept in ((all_ask, 0.0, True), (all_ask, 9.0, False), (half_ask, 0.0, False)):
        gained = nats * torch.tensor(asked)

        def below_no_light(hypothesis: Hypothesis, below: float = below) -> float:
            return below if "black_level" in hypothesis.effects else 0.0

        def fit(hypothesis: Hypothesis, *_: object, gained: torch.Tensor = gained, **__: object) -> BlindFit:
            of_black = torch.zeros_like(nats) if "black_level" in hypothesis.effects else -gained
            return replace(whole, hypothesis=hypothesis, log_likelihood=of_black)

        monkeypatch.setattr(search.fitter.likelihood, "below_no_light", below_no_light)
        monkeypatch.setattr(search.fitter, "fit", fit)
        assert ("black_level" in search.prune(replace(whole, log_likelihood=0 * nats)).hypothesis.effects) == kept


def test_all_blocks_are_asked_about_what_looks_like_another_scene(
    search: BlindSearch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the blocks that were fitted, a snapshot minds a black level; in all blocks it does not."""
    fitted = torch.zeros(16, dtype=torch.bool)
    fitted[::4] = True

    def on_all(hypothesis: Hypothesis, blocks: torch.Tensor) -> BlindFit:
        gained = 10.0 if "black_level" in hypothesis.effects else 0.0
        return replace(fit_of(search, "black_level", 0.3), log_likelihood=torch.full((16, 4), gained))

    monkeypatch.setattr(search.fitter, "evaluate", on_all)
    judge = CandidateAssessor(search.fitter, search.all_blocks, search.settings.min_gain_nats)  # remembers nothing yet
    nats = torch.where(fitted[:, None], torch.tensor([[9.0, 9.0, 9.0, -8.0]]), torch.nan)
    for name, agree in (("black_level", 4), ("mask_shift", 3)):
        fit = replace(fit_of(search, name, 1e-3, spread=1e-8), blocks=fitted, log_likelihood=nats)
        ideal = replace(fit, hypothesis=search.noise, log_likelihood=0 * nats)
        judged = judge(fit, ideal, name)
        assert (judged.comparison.agree, judged.comparison.nats) == (agree, 4 * 19.0)


def test_snapshots_themselves_rule_out_what_looks_like_another_scene(search: BlindSearch) -> None:
    """A black level stays an alternative if one of four snapshots prefers it, however clear the blocks are."""
    fit, rival = (fit_of(search, name, 0.3) for name in ("mask_contrast", "black_level"))
    for least, asked in ((1.0, True), (-1.0, False)):
        nats = torch.tensor([9.0, 9.0, 9.0, least], dtype=torch.float64).expand(16, 4)
        assert search.assessor.snapshots_prefer(replace(fit, log_likelihood=nats), rival) is asked
        few = replace(fit, log_likelihood=nats[:, :2])  # one or two scenes do not tell
        assert not search.assessor.snapshots_prefer(few, replace(rival, log_likelihood=rival.log_likelihood[:, :2]))


@pytest.mark.parametrize(
    ("least", "possible", "alternatives"),
    [(1.0, True, ("mask_blur",)), (-1.0, True, ("mask_blur", "black_level")), (-1.0, False, ("mask_blur",))],
)
def test_what_might_stand_in_the_place_of_an_effect(
    search: BlindSearch,
    monkeypatch: pytest.MonkeyPatch,
    least: float,
    possible: bool,
    alternatives: tuple[str, ...],
) -> None:
    """A blur that is as likely stays, and so does a possible black level that not all snapshots are against."""
    named = fit_of(search, "mask_contrast", 0.3, spread=1e-4)
    ahead = torch.tensor([9.0, 9.0, 9.0, least], dtype=torch.float64).expand(16, 4)
    monkeypatch.setattr(search.fitter, "evaluate", lambda hypothesis, blocks: replace(named, log_likelihood=0 * ahead))
    monkeypatch.setattr(
        search.fitter, "fit", lambda hypothesis, *_, **__: replace(named, hypothesis=hypothesis, log_likelihood=-ahead)
    )
    gained = compare(0 * ahead, -ahead, columns=4)
    black_level = replace(fit_of(search, "black_level", 0.3), log_likelihood=-ahead)
    rivals = [
        FittedCandidate(
            "mask_blur", replace(fit_of(search, "mask_blur", 0.3), log_likelihood=0 * ahead), gained, 32, 25
        ),
        FittedCandidate("black_level", black_level, gained, 32, 25, like_a_scene=True, possible=possible),
    ]
    monkeypatch.setattr(search, "rivals", lambda *_: rivals)
    (effect,) = search.evidence(named)
    assert (effect.name, effect.alternatives) == ("mask_contrast", alternatives)
    # what is exactly as likely has an equal share of the class
    assert sum(effect.shares.values()) == pytest.approx(1) and effect.shares["mask_blur"] == effect.shares[effect.name]


def test_a_start_of_which_no_block_is_left_is_the_last(search: BlindSearch) -> None:
    fit = replace(fit_of(search, "mask_contrast", 0.3), log_likelihood=torch.zeros(16, 4))
    assert _gain(replace(fit, log_likelihood=torch.full((16, 4), math.nan)), fit) == -math.inf


def test_a_black_level_is_refused_only_beyond_its_error(search: BlindSearch, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is weakened by its own error first; where the datasheet states no noise, nothing is impossible."""
    monkeypatch.setattr(
        search.fitter.likelihood,
        "below_no_light",
        lambda hypothesis: 100 * float(hypothesis.effects.get("black_level", {"offset": 0.0})["offset"]),
    )
    silent = search.fitter.model.observation
    monkeypatch.setattr(search.fitter.model, "observation", replace(silent, read_noise=1.0))
    gained = torch.full((16, 4), 50.0, dtype=torch.float64)
    for spread, error, possible in ((1e-6, 1e-3, False), (1e-4, 1e-2, True)):
        fit = replace(fit_of(search, "black_level", 0.05, spread=spread), log_likelihood=gained)
        weakened = search.fitter.weakened(fit, "black_level", 2.0).effects["black_level"]["offset"]
        assert weakened == pytest.approx(0.05 - 2 * error)
        without = replace(fit, hypothesis=search.noise, log_likelihood=0 * gained)
        assert search.assessor(fit, without, "black_level").possible is possible
        assert search.assessor(fit, replace(without, hypothesis=fit.hypothesis), "black_level").possible
    monkeypatch.setattr(search.fitter.model, "observation", silent)
    sure = replace(fit_of(search, "black_level", 0.05, spread=1e-6), log_likelihood=gained)
    assert search.assessor(
        sure, replace(sure, hypothesis=search.noise, log_likelihood=0 * gained), "black_level"
    ).possible


def test_blocks_that_are_lost_make_no_parameter_cheaper(search: BlindSearch) -> None:
    few = fit_of(search, "mask_shift", 0.3)
    few = replace(few, log_likelihood=torch.where(torch.arange(16)[:, None] < 8, 0.0, torch.nan).expand(16, 4))
    base = search.fitter.evaluate(search.noise, search.all_blocks)
    assert price(few, base) == pytest.approx(0.5 * 2 * math.log(8 * 4 * 64)) == pytest.approx(-price(base, few))
