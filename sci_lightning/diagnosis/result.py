"""What a diagnosis found, computed once: reports read it."""

from __future__ import annotations

from dataclasses import dataclass

from sci_lightning.diagnosis.bad_captures.leave_out import BadCapture
from sci_lightning.diagnosis.blind.unknown_scenes import UnknownScenes
from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.gap import Gap, Verification
from sci_lightning.diagnosis.fit.split import Split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.residual_tests import Residuals, ResidualTest
from sci_lightning.diagnosis.search.evidence import ErrorCorrelation, NamedEffect
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed
from sci_lightning.diagnosis.search.selection import Round
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.target_effects import SceneEffect
from sci_lightning.diagnosis.verdict import verdict
from sci_lightning.encoder.effects import Effect


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


@dataclass(frozen=True)
class Result:
    """The result of a diagnosis, computed once; reports only read it.

    Attributes:
        observation: the captures with known scenes that fits and choices have seen, in the order of all ``(N, ..)``
            tensors.
        model: the forward model; it predicts any hypothesis about its effects.
        split: which pixels were fitted and which were held out.
        settings: thresholds and budgets that were used.
        seed: of the residuals' randomisation.
        before: the ideal camera with the datasheet's noise.
        after: the corrected camera, with every named effect (and with the unnamed in free form, if that was asked for).
        effects: the named effects in the order in which light meets them, the laboratory's first; noise that differs
            from the datasheet's among them.
        unnamed: deviations that no effect of the vocabulary explains.
        rounds: what the search considered, round by round.
        stated_noise: names of the noise effects whose values the captures file states.
        correlation: of the errors of the corrected camera's parameters.
        remaining: residual tests that find more than noise in what the corrected camera leaves, see
            :func:`remaining_tests`; verdict and headline follow from them.
        verification: the gap on captures that nothing has seen, on which the verdict rests; None where none are kept.
        bad_captures: captures that do not fit the others and count nowhere.
        unknown_scenes: what snapshots of unknown scenes say about the corrected camera; None where there are none.
    """

    observation: Observation
    model: CameraModel
    split: Split
    settings: SearchSettings
    seed: int
    before: Assessment
    after: Assessment
    effects: tuple[NamedEffect, ...]
    unnamed: tuple[Unnamed, ...]
    rounds: tuple[Round, ...]
    stated_noise: tuple[str, ...]
    correlation: ErrorCorrelation
    remaining: tuple[ResidualTest, ...]
    verification: Verification | None = None
    bad_captures: tuple[BadCapture, ...] = ()
    unknown_scenes: UnknownScenes | None = None

    @property
    def judging(self) -> tuple[Gap, Gap]:
        """Gaps before and after on which the verdict rests: of verification captures, else of held-out pixels."""
        if self.verification is None:
            return self.before.gap, self.after.gap
        return self.verification.before, self.verification.after

    @property
    def verdict(self) -> str:
        """consistent, explained, partly_explained or unexplained: :func:`~sci_lightning.diagnosis.verdict.verdict`."""
        counts = len(self.effects), len(self.unnamed), len(self.remaining)
        return verdict(*self.judging, *counts)

    @property
    def laboratory(self) -> tuple[NamedEffect, ...]:
        """Those of :attr:`effects` by which the target differs from what the file says."""
        return tuple(effect for effect in self.effects if effect.effect.stage == SceneEffect.stage)

    @property
    def camera(self) -> tuple[NamedEffect, ...]:
        """Those of :attr:`effects` that belong to the camera."""
        return tuple(effect for effect in self.effects if effect.effect.stage != SceneEffect.stage)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of :attr:`effects`."""
        return tuple(effect.name for effect in self.effects)

    @property
    def considered(self) -> dict[str, type[Effect]]:
        """Effects that might have been named, by name: the vocabulary without noise, which every camera has."""
        return {name: effect for name, effect in self.model.vocabulary.items() if not effect.noise}

    @property
    def next_captures(self) -> tuple[str, ...]:
        """Captures that would tell the named effects from their alternatives, a sentence for each."""
        return tuple(dict.fromkeys(effect.tell_apart for effect in self.effects if effect.tell_apart))
