"""What chance allows follows from how many pixels were held out; the verdict and its sentence never contradict."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import torch

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.gap import Gap, held_out_gap, largest_by_chance, variance_of_squares
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.report.sentences import NOTHING_LEFT, headline
from sci_lightning.diagnosis.result import verdict
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.diagnosis.small_diagnosis import GHOST, SHIFT, diagnosed, with_p


@pytest.mark.parametrize("count", [40, 300, 3000])
def test_a_right_model_exceeds_the_limit_once_in_a_thousand_times(count: int) -> None:
    """Of 20,000 right models about 20 do; fewer than 5 or more than 40 happen less than once in 10,000 times."""
    random = torch.Generator().manual_seed(count)
    chi2 = torch.cat([torch.randn(2000, count, generator=random).square().mean(1) for _ in range(10)])
    assert 5 <= int((chi2 > largest_by_chance(1.0, 2 / count)).sum()) <= 40


def test_of_many_pixels_only_what_is_negligible_is_allowed() -> None:
    assert largest_by_chance(1.0, 2 / 500) > 1.2
    assert largest_by_chance(1.0, 2 / 8000) < SearchSettings.negligible_chi2 < largest_by_chance(1.0, 2 / 7000)


def test_the_variance_is_that_of_the_statistic() -> None:
    random = torch.Generator().manual_seed(0)
    gaussian = torch.randn(20000, generator=random)
    assert variance_of_squares(gaussian) == pytest.approx(2, abs=0.1)
    assert variance_of_squares(3 * gaussian) == pytest.approx(variance_of_squares(gaussian))  # misfit earns no leniency
    few_photons = (torch.poisson(torch.full((50000,), 4.0), generator=random) - 4) / 2
    assert variance_of_squares(few_photons) == pytest.approx(2 + 1 / 4, abs=0.12)  # the excess kurtosis is 1 / mean
    outlier = torch.cat((gaussian[:200], torch.tensor([50.0])))
    assert variance_of_squares(outlier) < 3  # or it would widen the limit that it is to exceed


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """A right model of few pixels."""
    path = tmp_path_factory.mktemp("few") / "a.h5"
    session = Session(size=(16, 16), dark=1, flat=2, all_on=0, all_off=0, pattern=2, static=1, dynamic=2)
    VirtualCamera(session).write(path, seed=3)
    return diagnose(read_captures(path), {name: vocabulary()[name] for name in ("gain", "shot_noise", "read_noise")})


def with_chi2(result: Diagnosis, chi2: float) -> Diagnosis:
    """The same with another chi2 on the held-out pixels."""
    before, after = (replace(each, gap=replace(each.gap, chi2=chi2)) for each in (result.before, result.after))
    return replace(result, before=before, after=after)


def limit(fit: Fit) -> float:
    return held_out_gap(fit, 0).chi2_limit


def test_few_pixels_whose_chi2_is_a_little_large_are_consistent(few: Diagnosis) -> None:
    assert few.after.gap.pixels < 1000 and 1.1 < few.after.gap.chi2_limit < 1.6
    other = with_chi2(few, 1.065)
    assert other.verdict == "consistent"
    sentence = headline(other)
    assert "agree with the ideal camera: held-out chi2 1.065 (chance alone reaches 1." in sentence


def test_few_pixels_whose_chi2_is_too_large_are_not(few: Diagnosis) -> None:
    other = with_chi2(few, 1.9)
    assert not other.remaining and other.verdict == "unexplained"
    sentence = headline(other)
    assert "disagree with the ideal camera (held-out chi2 1.900)" in sentence
    assert "no test of the residuals says where" in sentence and NOTHING_LEFT not in sentence


def test_estimated_parameters_and_maps_widen_the_limit(few: Diagnosis) -> None:
    fitter, fit = Fitter(few.model, few.split), few.after.fit
    free = fitter.fit(fit.hypothesis.with_effect("gain", {"factor": 1.0}))
    assert limit(free) > limit(replace(free, free=()))
    imperfections = few.model.imperfections
    model = CameraModel(
        few.observation, {**few.model.vocabulary, "prnu": vocabulary()["prnu"]}, imperfections=imperfections
    )
    fitter = Fitter(model, few.split)
    assert "prnu" not in few.model.effects  # a new model: the one of the diagnosis stays as it was
    mapped = fitter.fit(free.hypothesis.with_effect("prnu", {"std": 0.05}, fitter.model.zero_map("prnu")), iterations=2)
    uncertain = replace(mapped, maps={"prnu": replace(mapped.maps["prnu"], std=0.5)})
    assert limit(uncertain) > limit(replace(mapped, maps={})) + 0.01


def test_verdict_and_sentence_agree() -> None:
    """Whether something is named, unnamed or left, whatever chi2 was before and is after, and if likelihood falls."""
    shared: dict[str, Any] = {"rmse_dn": 1.5, "pixels": 2000, "chi2_limit": 1.1}
    for names, unnamed, structure, before, after, gained in product(
        (0, 1, 5), (0, 1), (0, 2), (0.4, 1.0, 30.0), (0.98, 1.04, 1.08, 1.3), (0.5, -0.5)
    ):
        first, second = Gap(**shared, chi2=before, nll=2 + gained), Gap(**shared, chi2=after, nll=2.0)
        result = diagnosed(names * (SHIFT,), unnamed * (GHOST,), structure * (with_p(1e-9),), first, second)
        word, sentence = result.verdict, headline(result)
        assert ("captures agree with" in sentence) == (word == "consistent"), sentence
        assert ("captures disagree with" in sentence) == (word == "unexplained"), sentence
        assert (NOTHING_LEFT in sentence) == (word in ("consistent", "explained")), sentence
        assert (", but " in sentence) == (word == "partly_explained"), sentence
        assert (word in ("consistent", "explained")) == (after <= 1.1 and not unnamed and not structure)
        assert not names or "displaced" in sentence or "mask_shift" in sentence


def test_a_name_counts_when_likelihood_rises_though_chi2_does_too() -> None:
    """Noise that was overestimated brings chi2 below 1, whatever else is wrong."""
    before = Gap(chi2=0.498, rmse_dn=1.0, nll=3.0, pixels=2000, chi2_limit=1.1)
    assert verdict(before, replace(before, chi2=1.008, nll=2.0), 1, 1, 0) == "partly_explained"


def test_explained_by_many_pixels_means_at_most_the_negligible(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    VirtualCamera(Session(size=(48, 48)), {"gain": {"factor": 0.9}}).write(path, seed=3)
    few = {name: vocabulary()[name] for name in ("gain", "shot_noise", "read_noise")}
    result = diagnose(read_captures(path), few)
    assert result.verdict == "explained"
    assert result.after.gap.chi2_limit == SearchSettings.negligible_chi2 == 1.05 >= result.after.gap.chi2
