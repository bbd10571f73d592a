"""A diagnosis from snapshots alone: which effects does the model of an ideal camera lack, whatever the scenes are?

The scenes are integrated out: patches of video have known statistics (:mod:`~sci_lightning.diagnosis.blind.prior`), so
that a hypothesis about the camera has a likelihood (:mod:`~sci_lightning.diagnosis.blind.likelihood`). The search is
that of a calibrated diagnosis in short (:mod:`~sci_lightning.diagnosis.blind.search`). The prior is only roughly right;
how far to trust a difference in likelihood follows from how much blocks and snapshots agree about it
(:mod:`~sci_lightning.diagnosis.blind.candidate_comparison`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from sci_lightning.captures import Captures
from sci_lightning.diagnosis import vocabulary as effects_vocabulary
from sci_lightning.diagnosis.blind.blind_fit import MIN_SNAPSHOTS, BlindFit, BlindFitter
from sci_lightning.diagnosis.blind.block_prediction import (
    PredictionVerdict,
    of_predictable_snapshots,
    predict_by_blocks,
)
from sci_lightning.diagnosis.blind.candidate_comparison import MaskEvidence
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import BLOCK, LONGEST_VIDEO, MOST_SLOTS, ScenePrior, statistics_for
from sci_lightning.diagnosis.blind.search import BlindSearch, NamedCandidate
from sci_lightning.diagnosis.blind.snapshots import (
    observe_snapshots,
    textured_part,
    usable_snapshots,
    useless_snapshots,
)
from sci_lightning.diagnosis.blind.undetermined import SHOWN_IF_STRONG, determined_effects, undetermined_effects
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting, datasheet_noise
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.result import Result
from sci_lightning.diagnosis.search.evidence import Estimate, NamedEffect
from sci_lightning.diagnosis.search.formula_error import IDEAL
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.encoder.effects import Effect, MaskContrast, MaskLevelGamma
from sci_lightning.errors import BadInput
from sci_lightning.prior import PatchPrior

MIN_USABLE_SHARE = 0.05
"""Part of the blocks without a saturated pixel below which nothing can be said."""
SEARCHED_SIDE_PX = 256
"""Side in pixels of the part of a larger field that is searched where there are many slots."""
OF_THE_FIELD = (
    "mask_rotation",
    "mask_scale",
    "mask_keystone",
    "mask_distortion",
    "mask_orientation",
    "lateral_colour",
    "rolling_shutter",
    "phased_reset",
)
"""Effects that depend on the place in the field, and are not looked for where only a part of it is searched."""
MAX_LISTED = 10
"""Largest number of snapshots that a note lists by their numbers."""
MOST_COMMANDED_LEVELS = 64
"""Distinct levels of a pattern that somebody commands, 6 bits; a pattern with more was measured."""
CALIBRATION: dict[str, Setting] = {"mask_contrast": {"leak": 0.02}, "mask_level_gamma": {"gamma": 1.0}}
"""What nobody knows of a measured gray mask, and where its fit starts: its contrast, and the curve of its levels."""
MEASURED = (
    "The mask was measured: its contrast and the curve of its levels are fitted as its calibration, and are no effects."
)
NO_MASK = (
    "No mask is to be seen in the snapshots: they have no texture, or other patterns were shown than the file says, or "
    "these were displaced further than the search looks."
)
AS_LIKELY_WITHOUT_MASK = (
    "A camera without any mask explains the snapshots nearly as well, so that nothing is corrected: the likeliest "
    "camera gains {gained:.3f} nats a pixel over the ideal one, and one without a mask {without:.3f}."
)
AS_PREDICTABLE_WITHOUT_MASK = (
    "A camera without any mask predicts held-out pixels as well as the likeliest one, so that nothing is corrected: "
    "only the likelihood of the snapshots, which relies on statistics of scenes, shows their mask."
)
RECORD = "a flat field behind the coding patterns, and an even scene behind one open pattern in one slot only"
"""What tells effects apart that snapshots of unknown scenes do not."""


@dataclass(frozen=True)
class BlindEffect(NamedEffect):
    """An effect that snapshots of unknown scenes support; ``delta_nll`` counts calibrated nats.

    Attributes:
        agree: snapshots that support it.
        snapshots: of how many.
        p_value: probability that chance alone prefers it so clearly, paired over tiles of blocks.
    """

    agree: int = 0
    snapshots: int = 0
    p_value: float = 1.0

    def describe(self) -> dict[str, Any]:
        """Return the effect as it stands in ``report.json``."""
        content = super().describe()
        content["evidence"] |= {"agree": [self.agree, self.snapshots], "p_value": self.p_value}
        return content | {"class": dict(self.shares)}


@dataclass(frozen=True, kw_only=True)
class BlindDiagnosis(Result):
    """The result of a diagnosis of snapshots of unknown scenes.

    Attributes:
        ideal: fit of the ideal camera.
        corrected: fit of the corrected camera.
        rounds: calibrated nats of the candidates that were fitted, by name, round by round.
        undetermined: what these snapshots cannot tell: the name of an effect, and what about the scenes looks alike.
            An effect that is seen only if it is strong stands here unless it is named.
        notes: what is unusual about the snapshots, in sentences.
        mask: what the snapshots say for the mask itself.
        calibration: contrast and curve of a measured gray mask by effect, which nobody knows; they are no deviation.
        prediction: what held-out pixels say about the corrected camera; None if they were not predicted.
        verification: numbers of the snapshots that were set aside: the search has not seen them.
        predicted: the snapshots, those set aside among them, in which held-out pixels were predicted; None if in none.
    """

    mode = "blind"
    ideal: BlindFit
    corrected: BlindFit
    effects: tuple[BlindEffect, ...]
    rounds: tuple[dict[str, float], ...]
    undetermined: Mapping[str, str]
    notes: tuple[str, ...]
    mask: MaskEvidence
    calibration: Mapping[str, Mapping[str, Estimate]] = field(default_factory=dict)
    prediction: PredictionVerdict | None = None
    verification: tuple[int, ...] = ()
    predicted: Observation | None = None

    @property
    def verdict(self) -> str:
        """``consistent`` where nothing is named, else ``explained``; nobody looked for what has no name.

        Where a camera without any mask explains the snapshots nearly as well, or predicts held-out pixels as well as
        the one that was named, it is ``undecided``; where an effect does not make held-out pixels more predictable, or
        snapshots that were set aside do not confirm what was named, ``partly_explained``.
        """
        needless = self.prediction is not None and not self.prediction.mask_helps()
        if not self.mask.decides or (self.effects and needless):
            return "undecided"
        if self.prediction is not None and self.prediction.contradicted():
            return "partly_explained"
        return "explained" if self.effects else "consistent"

    @property
    def hypothesis(self) -> Hypothesis:
        """The corrected camera; the ideal one where nothing is decided."""
        return self.ideal.hypothesis if self.verdict == "undecided" else self.corrected.hypothesis


def diagnose_blind(
    captures: Captures,
    vocabulary: Mapping[str, type[Effect]] | None = None,
    seed: int = 0,
    settings: SearchSettings | None = None,
    on_progress: Callable[[str], None] = lambda message: None,
    statistics: PatchPrior | None = None,
) -> BlindDiagnosis:
    """Find the effects that the model of an ideal camera lacks to explain snapshots of unknown scenes.

    Args:
        captures: of one camera; only those with unknown scenes are used.
        vocabulary: effects that may be named beside noise, by name; None for every effect of the package.
        seed: chooses the pixels that are held out, and stands in the report.
        settings: thresholds and budgets; None for the defaults.
        on_progress: called with a one-line message after every step of the search.
        statistics: of patches of video; None for those that come with the package.

    Raises:
        BadInput: see :func:`~sci_lightning.diagnosis.blind.snapshots.observe_snapshots`; or nearly every block of the
            snapshots has a saturated pixel; or there are more than 64 slots; or a setting was changed that only a
            calibrated diagnosis reads.
    """
    settings = settings or SearchSettings()
    settings.check_unknown_scenes()
    unknown = [int(number) for number in np.flatnonzero(~captures.known)]
    verification = [number for number in unknown if number in (captures.verification or ())]
    if verification and len(verification) == len(unknown):
        raise BadInput(
            f"{captures.name}: 'verification' sets all {len(unknown)} captures of unknown scenes aside; leave some to "
            "be fitted"
        )
    observation = observe_snapshots(captures, leave_out=verification)
    if observation.frames > MOST_SLOTS:
        raise BadInput(
            f"{captures.name}: {observation.frames} slots, where snapshots of unknown scenes are diagnosed up to "
            f"{MOST_SLOTS}: record captures of known scenes"
        )
    vocabulary = effects_vocabulary.with_noise(effects_vocabulary.vocabulary() if vocabulary is None else vocabulary)
    model = searched = _model(observation, vocabulary)
    part = textured_part(captures, SEARCHED_SIDE_PX, verification) if observation.frames > LONGEST_VIDEO else captures
    if part is not captures:
        of_a_part = {name: effect for name, effect in vocabulary.items() if name not in OF_THE_FIELD}
        searched = _model(observe_snapshots(part, leave_out=verification), of_a_part)
    if statistics is None:
        on_progress("statistics of the scenes")
        patterns = observation.patterns[observation.sequences[0]] if observation.grid is None else None
        statistics = statistics_for(observation.frames, patterns)
    prior = ScenePrior(observation.frames, statistics)
    likelihood = BlindLikelihood(searched, prior)
    if (usable := float(likelihood.usable.double().mean())) < MIN_USABLE_SHARE:
        raise BadInput(
            f"{captures.name}: {100 * (1 - usable):.0f} % of the blocks of {BLOCK} x {BLOCK} pixels are saturated "
            f"({observation.full_scale} DN): reduce exposure or aperture"
        )
    noise, stated = datasheet_noise(observation)
    nuisance = CALIBRATION if is_measured(observation) else {}
    fitter = BlindFitter(likelihood)
    explanation = BlindSearch(fitter, noise, settings, on_progress, nuisance).run()
    fit, names = explanation.fit, [one.name for one in explanation.named]
    prediction = predicted = None
    if explanation.mask.visible:
        numbers = sorted([*observation.number.tolist(), *usable_snapshots(captures, observation.number.tolist())])
        seen = observe_snapshots(part.take(numbers))
        seen = replace(seen, number=torch.tensor(numbers)[seen.number])
        cameras, every = (noise, fit.hypothesis), BlindLikelihood(_model(seen, vocabulary), prior)
        if (of_predicted := of_predictable_snapshots(every, *cameras)) is not None:
            predicted = of_predicted.model.observation
            judging = [place for place, number in enumerate(predicted.number.tolist()) if number in verification]
            prediction = predict_by_blocks(of_predicted, *cameras, names, judging, seed)
            gap = prediction.gap
            on_progress(f"held-out pixels: prediction error {gap.before:.4f} to {gap.after:.4f}")
    calibration = {name: _estimates(model, fit, name) for name in nuisance if name in fit.hypothesis.effects}
    weak = {name: why for name, why in SHOWN_IF_STRONG.items() if name in vocabulary and name not in names}
    return BlindDiagnosis(
        observation=observation,
        model=model,
        settings=settings,
        seed=seed,
        ideal=explanation.ideal,
        corrected=fit,
        effects=tuple(_named(model, fit, one) for one in explanation.named),
        rounds=explanation.rounds,
        considered=determined_effects(searched),
        undetermined=undetermined_effects(model) | weak,
        notes=_notes(captures, likelihood, explanation.mask, prediction) + (MEASURED,) * bool(calibration),
        mask=explanation.mask,
        calibration=calibration,
        prediction=prediction,
        verification=tuple(verification),
        predicted=predicted,
        stated_noise=tuple(effect for effect, _ in stated),
    )


def is_measured(observation: Observation) -> bool:
    """Return whether patterns have more levels than anybody commands, so that they were measured."""
    return len(observation.patterns[observation.sequences[0, 0]].unique()) > MOST_COMMANDED_LEVELS


def _model(observation: Observation, vocabulary: Mapping[str, type[Effect]]) -> CameraModel:
    """Return the forward model, which can weaken the mask whether or not a lower contrast may be named."""
    unnamed: dict[str, type[Effect]] = {"mask_contrast": MaskContrast, "mask_level_gamma": MaskLevelGamma}
    return CameraModel(observation, vocabulary, unnamed)


def _named(model: CameraModel, fit: BlindFit, named: NamedCandidate) -> BlindEffect:
    """Return an effect with its parameters, their errors, and what speaks for it."""
    others = " or ".join(named.alternatives)
    advice = f"To tell {named.name} from {others}, record captures of something known: {RECORD}." if others else ""
    return BlindEffect(
        model.effects[named.name],
        _estimates(model, fit, named.name),
        named.nats,
        2 * (named.nats - named.penalty),
        named.alternatives,
        advice,
        named.comparison.agree,
        named.comparison.snapshots,
        named.comparison.p_value,
        shares=named.shares,
    )


def _estimates(model: CameraModel, fit: BlindFit, name: str) -> dict[str, Estimate]:
    """Return the parameters of an effect with their errors."""
    deviations = dict(zip(fit.free, fit.covariance.diagonal().clamp(min=0).sqrt().tolist(), strict=True))
    estimates = {}
    for parameter, about in model.effects[name].about.items():
        value, std = fit.hypothesis.effects[name][parameter], deviations.get((name, parameter), 0.0)
        estimates[parameter] = Estimate.of(value, about, std, IDEAL)
    return estimates


def _notes(
    captures: Captures, likelihood: BlindLikelihood, mask: MaskEvidence, prediction: PredictionVerdict | None
) -> tuple[str, ...]:
    """Say what is unusual about the snapshots, first why they decide nothing where they do not."""
    notes, count = [], len(likelihood.model.observation)
    if not mask.visible:
        notes.append(NO_MASK)
    elif not mask.decides:
        notes.append(AS_LIKELY_WITHOUT_MASK.format(gained=mask.gained, without=mask.gained_without))
    elif prediction is not None and not prediction.mask_helps():
        notes.append(AS_PREDICTABLE_WITHOUT_MASK)
    if count < MIN_SNAPSHOTS:
        what = "One snapshot says" if count == 1 else "Two snapshots say"
        notes.append(f"{what} little about how scenes differ: uncertainties are widened.")
    useless = useless_snapshots(captures)
    for reason in dict.fromkeys(useless.values()):
        numbers = [number for number, why in useless.items() if why == reason]
        listed = ", ".join(map(str, numbers[:MAX_LISTED])) + ", .." * (len(numbers) > MAX_LISTED)
        what = f"Snapshot {listed} is" if len(numbers) == 1 else f"{len(numbers)} snapshots ({listed}) are"
        notes.append(f"{what} left out: {reason}. Snapshots are counted from 0.")
    saturated = 1 - float(likelihood.usable.double().mean())
    if saturated > 0.01:
        notes.append(f"{100 * saturated:.0f} % of the blocks have a saturated pixel and are left out.")
    if known := int(captures.known.sum()):
        notes.append(f"{known} captures with known scenes are not used.")
    return tuple(notes)
