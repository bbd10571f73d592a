"""Snapshots of unknown scenes beside captures of known ones: they judge the corrected camera once more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.blind.held_out.paired_comparison import (
    WITHOUT_MASK,
    PairedComparison,
    compare,
    predictor_of,
)
from sci_lightning.diagnosis.blind.snapshot_camera import snapshots_of
from sci_lightning.diagnosis.blind.snapshots import usable_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis
from sci_lightning.errors import BadInput


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
            f"{gap.snapshots} ask for it), and to {self.without_mask.before:.3g} without any mask."
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
        model: builds the light path of a hypothesis.
        ideal, corrected: what the known scenes say; effects of the laboratory do not act on other scenes.
        seed: of the held-out pixels.
        on_progress: called with a one-line message at the end.

    Returns:
        None where no scene is unknown, or where no snapshot is of use: black, saturated, without a mask.
    """
    if captures.known.all():
        return None
    useful = usable_snapshots(captures).tolist()
    if not useful:
        return None
    try:
        camera = snapshots_of(captures.take(useful), model.vocabulary)
        predictor = predictor_of(camera, (model.border(ideal) | model.border(corrected)).rounded(), seed)
    except BadInput:
        return None
    paths = (model.path(ideal), model.path(corrected), WITHOUT_MASK)
    before, after, without_mask = (predictor.errors(camera.encoder_of(path)) for path in paths)
    numbers = tuple(useful[place] for place in camera.numbers)
    judged = UnknownScenes(numbers, compare(before, after), compare(without_mask, after))
    on_progress(f"snapshots of unknown scenes: prediction error {judged.gap.before:.4f} to {judged.gap.after:.4f}")
    return judged
