"""What a diagnosis found, computed once: reports read it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from sci_lightning.diagnosis.bad_captures.leave_out import BadCapture
from sci_lightning.diagnosis.blind.unknown_scenes import UnknownScenes
from sci_lightning.diagnosis.fit.budget import Budget
from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.gap import Gap, Verification
from sci_lightning.diagnosis.fit.split import Split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.residual_tests import Residuals, ResidualTest
from sci_lightning.diagnosis.search.evidence import ErrorCorrelation, NamedEffect
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed
from sci_lightning.diagnosis.search.selection import Round
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.target_effects import SceneEffect
from sci_lightning.encoder.effects import Effect


def verdict(before: Gap, after: Gap, named: int, unnamed: int, remaining: int) -> str:
    """Return ``consistent``, ``explained``, ``partly_explained`` or ``unexplained``.

    Nothing is left if the misfit is within what chance allows, nothing unnamed was found, and no residual test objects.
    Then the captures are ``consistent`` with the ideal camera, or ``explained`` by the effects named. Otherwise they
    are ``partly_explained`` if the effects named make the held-out pixels likelier. Likelihood decides here and not
    chi2, because chi2 rises towards 1 where the noise had been overestimated.

    Args:
        before: gap of the ideal camera, on verification captures where some are kept.
        after: gap of the corrected model, on the same pixels.
        named: how many effects were named.
        unnamed: how many deviations without a name were found.
        remaining: how many residual tests find more than noise in what the corrected model leaves.
    """
    if after.within_chance and not unnamed and not remaining:
        return "explained" if named else "consistent"
    return "partly_explained" if named and after.nll < before.nll else "unexplained"


@dataclass(frozen=True)
class Assessment:
    """One model of the camera and how well it agrees with the captures.

    Attributes:
        fit: the fitted model.
        gap: misfit on held-out pixels.
        residuals: randomised quantile residuals of every pixel.
        tests: every residual test, with p-values corrected for their number.
    """

    fit: Fit
    gap: Gap
    residuals: Residuals
    tests: tuple[ResidualTest, ...]


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of a diagnosis, of known or unknown scenes; reports only read it.

    Attributes:
        observation: the captures that fits and choices have seen, in the order of all ``(N, ..)`` tensors.
        model: the forward model; it predicts any hypothesis about its effects.
        settings: thresholds and budgets that were used.
        seed: of the randomised residuals, and of the choice of held-out pixels.
        effects: the named effects in the order in which light meets them, the laboratory's first; noise that differs
            from the datasheet's among them.
        considered: classes of the effects that might have been named, by name.
        stated_noise: names of the noise effects whose values the captures file states.
        mode: ``calibrated`` where scenes are known, else ``blind``.
    """

    mode: ClassVar[str]

    observation: Observation
    model: CameraModel
    settings: SearchSettings
    seed: int
    effects: tuple[NamedEffect, ...]
    considered: Mapping[str, type[Effect]]
    stated_noise: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """consistent, explained, partly_explained or unexplained."""
        raise NotImplementedError

    @property
    def hypothesis(self) -> Hypothesis:
        """The corrected camera."""
        raise NotImplementedError

    @property
    def laboratory(self) -> tuple[NamedEffect, ...]:
        """Those of :attr:`effects` by which the target differs from what the file says."""
        return tuple(effect for effect in self.effects if effect.effect.stage == SceneEffect.stage)

    @property
    def camera_effects(self) -> tuple[NamedEffect, ...]:
        """Those of :attr:`effects` that belong to the camera."""
        return tuple(effect for effect in self.effects if effect.effect.stage != SceneEffect.stage)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of :attr:`effects`."""
        return tuple(effect.name for effect in self.effects)

    @property
    def next_captures(self) -> tuple[str, ...]:
        """Captures that would tell the named effects from their alternatives, a sentence for each."""
        return tuple(dict.fromkeys(effect.tell_apart for effect in self.effects if effect.tell_apart))


@dataclass(frozen=True, kw_only=True)
class CalibratedResult(Result):
    """The result of a diagnosis of captures with known scenes.

    Attributes:
        split: which pixels were fitted and which were held out.
        before: the ideal camera with the datasheet's noise.
        after: the corrected camera, with every named effect (and with the unnamed in free form, if that was asked for).
        unnamed: deviations that no effect of the vocabulary explains.
        rounds: what the search considered, round by round.
        correlation: of the errors of the corrected camera's parameters.
        remaining: residual tests that find more than noise in what the corrected camera leaves, see
            :func:`~sci_lightning.diagnosis.diagnosis.remaining_tests`; verdict and headline follow from them.
        verification: the gap on captures that nothing has seen, on which the verdict rests; None where none are kept.
        bad_captures: captures that do not fit the others and count nowhere.
        imperfections: errors of the laboratory that the model of every camera contains, where they are certain.
        budget: processor time, and what was left out for lack of it.
        unknown_scenes: what snapshots of unknown scenes say about the corrected camera; None where there are none.
        not_named: how probable other effects are that were fitted beside the named ones, by name.
    """

    mode = "calibrated"
    split: Split
    before: Assessment
    after: Assessment
    unnamed: tuple[Unnamed, ...]
    rounds: tuple[Round, ...]
    correlation: ErrorCorrelation
    budget: Budget
    remaining: tuple[ResidualTest, ...]
    verification: Verification | None = None
    bad_captures: tuple[BadCapture, ...] = ()
    imperfections: tuple[NamedEffect, ...] = ()
    unknown_scenes: UnknownScenes | None = None
    not_named: Mapping[str, float] = field(default_factory=dict)

    @property
    def judging(self) -> tuple[Gap, Gap]:
        """Gaps before and after on which the verdict rests: of verification captures, else of held-out pixels."""
        if self.verification is None:
            return self.before.gap, self.after.gap
        return self.verification.before, self.verification.after

    @property
    def verdict(self) -> str:
        """consistent, explained, partly_explained or unexplained: :func:`verdict`."""
        counts = len(self.effects), len(self.unnamed), len(self.remaining)
        return verdict(*self.judging, *counts)

    @property
    def hypothesis(self) -> Hypothesis:
        """The corrected camera."""
        return self.after.fit.hypothesis
