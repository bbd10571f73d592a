"""A diagnosis: from captures to the effects that a model of the camera lacks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.gap import gap
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.noise import stated
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.residual_tests import Residuals, ResidualTest
from sci_lightning.diagnosis.residual_tests.where import ask
from sci_lightning.diagnosis.search.explain import explain
from sci_lightning.diagnosis.search.remaining_misfit import IMPRECISE, Unnamed
from sci_lightning.diagnosis.search.search import Round
from sci_lightning.diagnosis.verdict import verdict
from sci_lightning.encoder.effects import Effect

CERTAIN = 1e-4
"""P-value of a residual test, corrected, below which something is left whatever chi2 says."""


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Attributes:
        fitter: of the captures: observation, split and model are in it.
        before: the ideal camera with the datasheet's noise.
        after: with everything that was named; in free form what was not, if that was asked for.
        complete: with both in any case.
        names: effects found, in the order of the light, noise that differs from the datasheet's among them.
        rounds: what was considered, round by round.
        unnamed: what is left.
        stated: noise effects whose values the captures file states.
        gaps: ``before`` and ``after``, see :func:`gap`.
        seed: of the randomised residuals.
    """

    fitter: Fitter
    before: Fit
    after: Fit
    complete: Fit
    names: tuple[str, ...]
    rounds: tuple[Round, ...]
    unnamed: tuple[Unnamed, ...]
    stated: tuple[str, ...]
    gaps: dict[str, dict[str, Any]]
    seed: int

    @property
    def verdict(self) -> str:
        """consistent, explained, partly_explained or unexplained: :func:`~sci_lightning.diagnosis.verdict.verdict`."""
        return verdict(self.gaps, len(self.names), len(self.unnamed), len(self.left))

    @cached_property
    def residuals(self) -> dict[str, Residuals]:
        """``before`` and ``after``."""
        return {
            "before": Residuals.of(self.fitter, self.before, self.seed),
            "after": Residuals.of(self.fitter, self.after, self.seed),
        }

    @cached_property
    def where(self) -> dict[str, list[ResidualTest]]:
        """``before`` and ``after``: what the residuals were asked, and their answers."""
        return {when: ask(residuals) for when, residuals in self.residuals.items()}

    @cached_property
    def left(self) -> list[ResidualTest]:
        """Residual tests that find more than noise in what is left by the model with everything that was named.

        These are the tests that the verdict and its sentence speak of. A test about mean or variance has to find more
        nats than come from the formulas of strong effects being a little inexact. If no noise was named, the p-value
        has to be below ``CERTAIN``. If some was, ``SIGNIFICANT`` is enough: noise explains variance only, so that it
        stands in for something else as long as the residuals have a structure.
        """
        inexact = IMPRECISE * self.fitter.explained(self.after, self.before, self.after)
        noise = any(self.fitter.model.known[name].noise for name in self.names)
        return [
            test
            for test in self.where["after"]
            if test.significant
            and (noise or test.corrected < CERTAIN)
            and (test.about in ("map", "converter") or test.nats > inexact)
        ]


def diagnose(
    captures: Captures,
    vocabulary: Mapping[str, type[Effect]],
    seed: int = 0,
    most: int = 6,
    empirical: bool = False,
    told: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Find the effects that the ideal camera lacks to explain the captures.

    Args:
        captures: of one camera.
        vocabulary: effects that may be named.
        seed: of the randomised residuals.
        most: effects to be found at most.
        empirical: whether what has no name is added to the model in free form.
        told: is called with a line of text whenever there is news.

    Raises:
        BadInput: no capture with a known scene, all saturated, or all black.
    """
    observation = observe(captures)
    fitter = Fitter(CameraModel(observation, vocabulary), split(observation))
    noise, fixed = stated(fitter)
    before = fitter.fit(noise, fixed=fixed, iterations=30)
    complete, names, rounds, unnamed = explain(fitter, before, noise, most, told)
    after = complete
    if unnamed and not empirical:  # the noise stays: it must not take up what has no name
        named = complete.hypothesis
        for each in unnamed:
            named = named.without(each.name)
        after = fitter.fit(named, fixed=tuple((each, name) for each in noise.effects for name in noise.effects[each]))
    return Diagnosis(
        fitter=fitter,
        before=before,
        after=after,
        complete=complete,
        names=tuple(sorted(names, key=lambda name: vocabulary[name].rank)),
        rounds=tuple(rounds),
        unnamed=tuple(unnamed),
        stated=tuple(name for name, _ in fixed),
        gaps={"before": gap(fitter, before, seed), "after": gap(fitter, after, seed)},
        seed=seed,
    )
