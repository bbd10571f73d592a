"""Snapshots of unknown scenes beside captures of known ones judge the corrected camera once more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.blind.block_prediction import BlockPredictor, of_predictable_snapshots, predicted_blocks
from sci_lightning.diagnosis.blind.held_out_pixels import PairedComparison, compare_errors
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import MOST_SLOTS, ScenePrior, statistics_for
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots, textured_part
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.target_effects import SceneEffect
from sci_lightning.encoder.effects import MaskContrast
from sci_lightning.errors import BadInput

LARGEST_FIELD_PX = 512
"""Side in pixels beyond which only the window of this side with the most texture is predicted."""


@dataclass(frozen=True)
class UnknownScenes:
    """How well two cameras predict held-out pixels of snapshots whose scenes nobody knows.

    Attributes:
        captures: numbers of the snapshots in their file.
        gap: the ideal camera against the corrected one.
        without_mask: a camera whose mask is the same everywhere against the corrected one.
    """

    captures: tuple[int, ...]
    gap: PairedComparison
    without_mask: PairedComparison

    def describe(self) -> dict[str, Any]:
        """Return this as it stands in ``report.json``."""
        gap = self.gap
        return {
            "captures": list(self.captures),
            "prediction_error": {"before": gap.before, "after": gap.after, "without_mask": self.without_mask.before},
            "agree": [gap.agree, gap.snapshots],
            "p_value": gap.p_value,
        }

    def sentence(self) -> str:
        """Return what they say about the corrected camera, in a sentence."""
        gap, count = self.gap, len(self.captures)
        return (
            f"{count} snapshot{'s' * (count > 1)} of unknown scenes: held-out pixels are predicted to {gap.before:.3g} "
            f"of their spread by the ideal camera, to {gap.after:.3g} by the corrected one ({gap.agree} of "
            f"{gap.snapshots} support it), and to {self.without_mask.before:.3g} without any mask."
        )


def judged_by_unknown_scenes(
    captures: Captures,
    model: CameraModel,
    ideal: Hypothesis,
    corrected: Hypothesis,
    seed: int,
    on_progress: Callable[[str], None],
) -> UnknownScenes | None:
    """Predict held-out pixels of the captures with unknown scenes by the ideal and by the corrected camera.

    Args:
        captures: with known and unknown scenes.
        model: knows the effects of the hypotheses.
        ideal, corrected: what the known scenes say. Effects of the laboratory do not act on other scenes; maps of the
            sensor and deviations without a name are left out.
        seed: of the held-out pixels.
        on_progress: called with a one-line message at the end.

    Returns:
        None where no scene is unknown, where no snapshot is of use (black, saturated, without a mask), or where there
        are more slots than statistics of scenes reach over.
    """
    if captures.known.all() or captures.sequence.shape[1] > MOST_SLOTS:
        return None
    try:
        part = textured_part(captures, LARGEST_FIELD_PX)
        observation = observe_snapshots(part)
    except BadInput:
        return None
    seen = CameraModel(observation, model.vocabulary, {"mask_contrast": MaskContrast})
    prior = ScenePrior(observation.frames, statistics_for(observation.frames, observation.patterns))
    before, after = (_of_the_camera(model, one) for one in (ideal, corrected))
    likelihood = of_predictable_snapshots(BlindLikelihood(seen, prior), before, after)
    if likelihood is None:
        return None
    predictor = BlockPredictor(likelihood, predicted_blocks(likelihood, before, after), folds=2, seed=seed)
    cameras = (before, after, before.with_effect("mask_contrast", {"leak": 1.0}))
    ideal_errors, corrected_errors, without_mask = (predictor.errors(camera) for camera in cameras)
    gap = compare_errors(ideal_errors, corrected_errors)
    on_progress(f"snapshots of unknown scenes: prediction error {gap.before:.4f} to {gap.after:.4f}")
    numbers = tuple(likelihood.model.observation.number.tolist())
    return UnknownScenes(numbers, gap, compare_errors(without_mask, corrected_errors))


def _of_the_camera(model: CameraModel, hypothesis: Hypothesis) -> Hypothesis:
    """Return what of a hypothesis a camera has in every snapshot, the same at every pixel."""
    kept = {}
    for name, setting in hypothesis.effects.items():
        effect = model.effects[name]
        if name in model.vocabulary and not (effect.map_kind or issubclass(effect, SceneEffect)):
            kept[name] = setting
    return Hypothesis(kept)
