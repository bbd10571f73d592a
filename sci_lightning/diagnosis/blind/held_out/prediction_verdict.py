"""The verdict of held-out pixels on a diagnosis: does every named effect make them more predictable?"""

from __future__ import annotations

from dataclasses import dataclass

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.diagnosis.blind.held_out.paired_comparison import PairedComparison
from sci_lightning.diagnosis.blind.held_out.prediction import Predictor, textured_window
from sci_lightning.diagnosis.blind.snapshot_camera import SnapshotCamera
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import MaskContrast
from sci_lightning.encoder.light_path import LightPath

LARGEST_FIELD = 512
"""Side in pixels beyond which only the window of this side with the most texture is judged."""
MASK_HELPS = 0.01
"""p-value below which the mask helps to predict held-out pixels."""
WITHOUT_MASK = LightPath([MaskContrast(leak=1.0)])
"""A camera whose mask is the same everywhere."""
INDIFFERENT = 1e-4
"""Part of the prediction error below which a change of it is a matter of rounding."""


@dataclass(frozen=True)
class PredictionVerdict:
    """What held-out pixels say about the camera that a diagnosis found.

    Attributes:
        gap: the ideal camera against the corrected one.
        by_effect: the corrected camera without one of its effects against the whole one, by effect.
        without_mask: a camera whose mask is the same everywhere against the corrected one. Whatever weakens a wrong
            mask makes held-out pixels more predictable; only what is better than no mask at all speaks for a camera.
        verification: ``gap`` on the snapshots that were set aside; None where there are none.
    """

    gap: PairedComparison
    by_effect: dict[str, PairedComparison]
    without_mask: PairedComparison
    verification: PairedComparison | None = None

    def mask_helps(self) -> bool:
        """Return whether the corrected camera predicts held-out pixels better than one without any mask."""
        return self.without_mask.fall > 0 and self.without_mask.p_value < MASK_HELPS

    def contradicted(self, max_p_value: float = 0.05) -> tuple[str, ...]:
        """Return the effects that change what is predicted and do not make held-out pixels more predictable.

        Effects that a decoder absorbs, such as another order of the patterns, have no vote. Where snapshots that were
        set aside do not confirm the whole camera, all of its effects are contradicted.
        """
        if self.verification is not None and _speaks_against(self.verification, max_p_value):
            return tuple(self.by_effect)
        return tuple(name for name, evidence in self.by_effect.items() if _speaks_against(evidence, max_p_value))


def _speaks_against(evidence: PairedComparison, max_p_value: float) -> bool:
    return abs(evidence.fall) > INDIFFERENT and evidence.p_value > max_p_value


def predictor_of(
    camera: SnapshotCamera, border: Border | None, seed: int, decoder: Decoder | None = None, folds: int = 2
) -> Predictor:
    """Return what predicts held-out pixels of snapshots; of a large field, the window with the most texture."""
    window = textured_window(camera.measurement, LARGEST_FIELD) if max(camera.size) > LARGEST_FIELD else None
    return Predictor(camera.measurement, decoder, folds=folds, seed=seed, border=border, window=window)
