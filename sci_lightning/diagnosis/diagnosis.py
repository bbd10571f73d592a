"""A diagnosis: from captures to the effects that the model of an ideal camera lacks.

The method has five steps, one folder each. A forward **model** of the camera predicts mean and variance of every pixel
(:mod:`~sci_lightning.diagnosis.model`). A maximum-likelihood **fit** estimates the parameters of a hypothesis
(:mod:`~sci_lightning.diagnosis.fit`). A **search** adds the effects that the captures ask for
(:mod:`~sci_lightning.diagnosis.search`). **Residual tests** look for what the model still misses
(:mod:`~sci_lightning.diagnosis.residual_tests`). The **report** says so (:mod:`~sci_lightning.diagnosis.report`); it
computes nothing, everything that it needs is in :class:`Diagnosis`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sci_lightning.captures import Captures
from sci_lightning.diagnosis import vocabulary as effects_vocabulary
from sci_lightning.diagnosis.bad_captures.leave_out import bad_verification_captures, explain_without_bad_captures
from sci_lightning.diagnosis.blind.unknown_scenes import judged_by_unknown_scenes
from sci_lightning.diagnosis.fit.budget import SECONDS_PER_PIXEL, Budget
from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.gap import held_out_gap, verify
from sci_lightning.diagnosis.fit.split import set_aside
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.model.imperfections import imperfections_of
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.residual_tests import Residuals, ResidualTest
from sci_lightning.diagnosis.residual_tests.all_tests import residual_tests
from sci_lightning.diagnosis.result import Assessment, CalibratedResult
from sci_lightning.diagnosis.search.evidence import error_correlation, imperfections_in, named_effects
from sci_lightning.diagnosis.search.search import with_likeliest_place
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.encoder.effects import Effect

if TYPE_CHECKING:  # a diagnosis without pictures does not load matplotlib
    from matplotlib.figure import Figure


MAX_RESIDUAL_P_VALUE = 1e-4
"""Corrected p-value of a residual test below which something is left while the noise is the datasheet's; one tenth of
``SearchSettings.significance``, because formulas are not exact."""
FORMULA_NATS_SHARE = 2e-4
"""Part of the log-likelihood gained by the corrected camera that its formulas may be wrong by."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis(CalibratedResult):
    """The result of a diagnosis, which writes and draws itself; see :class:`.CalibratedResult`."""

    def save(self, folder: str | Path) -> None:
        """Write ``report.json``, ``report.html``, ``encoder.yaml`` and the pictures into a folder."""
        from sci_lightning.diagnosis.report.report import write_report

        write_report(self, folder)

    def plot(self) -> dict[str, Figure]:
        """Draw the pictures of the report; a dictionary of figures by file name."""
        from sci_lightning.diagnosis.report.pictures import figures

        return figures(self)


def diagnose(
    captures: Captures,
    vocabulary: Mapping[str, type[Effect]] | None = None,
    seed: int = 0,
    free_forms: bool = False,
    settings: SearchSettings | None = None,
    on_progress: Callable[[str], None] = lambda message: None,
    budget: float | None = None,
) -> Diagnosis:
    """Find the effects that the model of an ideal camera lacks to explain the captures.

    Args:
        captures: of one camera, see :func:`~sci_lightning.captures.read_captures`. Those of unknown scenes are not
            fitted; they judge the corrected camera once more.
        vocabulary: effects that may be named beside noise, by name; None for every effect of the package.
        seed: of the residuals' randomisation.
        free_forms: whether the corrected camera contains what has no name, in free form.
        settings: thresholds; None for the defaults.
        on_progress: called with a one-line message after every step of the search.
        budget: seconds of processor time after which the search begins nothing new; None for 120 seconds for 34
            captures of 64 x 64 pixels, and more for more.

    Raises:
        BadInput: no capture with a known scene, all saturated, or all black.
    """
    settings = settings or SearchSettings()
    everything = observe(captures)
    seen, unseen = set_aside(everything, settings.verification_one_in)
    names_of_effects = effects_vocabulary.with_noise(
        effects_vocabulary.vocabulary() if vocabulary is None else vocabulary
    )
    time = Budget(everything.dn.numel() * SECONDS_PER_PIXEL if budget is None else budget)
    camera = CameraModel(seen, names_of_effects, imperfections=imperfections_of(everything))
    explanation, bad = explain_without_bad_captures(camera, settings, time, on_progress)
    model, ideal = explanation.fit.fitter.model, explanation.ideal
    observation = model.observation
    if unseen is not None and settings.find_bad_captures:
        odd, worse = bad_verification_captures(explanation.fit, observation, unseen, everything)
        unseen, bad = None if odd.all() else unseen.take(~odd), (*bad, *worse)
    before, after = (assess(fit, seed) for fit in (ideal, explanation.corrected(free_forms)))
    remaining = remaining_tests(before, after)
    left = remaining or not after.gap.within_chance
    if left and not explanation.unnamed and time.allows("where something is left", share=1.0):
        explanation = with_likeliest_place(explanation, on_progress)
        before, after = (assess(fit, seed) for fit in (explanation.ideal, explanation.corrected(free_forms)))
        remaining = remaining_tests(before, after)
    corrected = after.fit
    # more noise than stated makes room for what is left, and is no finding of its own beside that
    noise = {} if explanation.unnamed or remaining else explanation.noise
    names = sorted((*explanation.names, *noise), key=lambda name: model.vocabulary[name].rank)
    return Diagnosis(
        observation=observation,
        model=model,
        split=explanation.fit.fitter.split,
        settings=settings,
        seed=seed,
        before=before,
        after=after,
        effects=named_effects(explanation.fit, names, noise),
        unnamed=explanation.unnamed,
        rounds=explanation.rounds,
        considered={
            name: effect for name, effect in model.vocabulary.items() if not (effect.noise or effect.imperfection)
        },
        stated_noise=tuple(effect for effect, _ in datasheet_noise(observation)[1]),
        correlation=error_correlation(corrected),
        remaining=remaining,
        verification=None if unseen is None else verify(before.fit, after.fit, unseen, seed),
        bad_captures=bad,
        budget=time,
        not_named=explanation.not_named,
        imperfections=imperfections_in(explanation.fit),
        unknown_scenes=judged_by_unknown_scenes(
            captures, model, ideal.hypothesis, explanation.fit.hypothesis, seed, on_progress
        ),
    )


def assess(fit: Fit, seed: int) -> Assessment:
    """Judge a fitted model by its gap on held-out pixels and by every residual test.

    Args:
        fit: the fitted model.
        seed: of the residuals' randomisation.
    """
    residuals = Residuals.of(fit, seed)
    return Assessment(fit, held_out_gap(fit, seed), residuals, tuple(residual_tests(residuals)))


def remaining_tests(before: Assessment, after: Assessment) -> tuple[ResidualTest, ...]:
    """Return the residual tests that find more than noise in what the corrected camera leaves.

    The formulas of strong effects are a little inexact, and the errors of a laboratory are described coarsely. A test
    about mean or variance therefore has to find more than a part of the log-likelihood that the corrected camera gains,
    and more than the errors of the laboratory gain, unless these are as large as they may be; and the p-value has to be
    below ``MAX_RESIDUAL_P_VALUE``.
    """
    inexact = FORMULA_NATS_SHARE * after.fit.explained_nats(before.fit)
    if not after.fit.beyond_laboratory:
        inexact += sum(max(one.evidence, 0.0) for one in after.fit.maps.values() if one.of_captures)
    return tuple(
        test
        for test in after.tests
        if test.significant
        and test.corrected < MAX_RESIDUAL_P_VALUE
        and (test.about in ("map", "converter") or test.nats > inexact)
    )
