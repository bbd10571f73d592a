"""Real snapshots of a spectral camera whose mask, as it was measured, is sharper than the one in the camera."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
from sci_lightning.diagnosis.vocabulary import vocabulary
from tests.diagnosis.cassi_tsa import read_cassi


@pytest.mark.slow
def test_a_camera_without_a_mask_explains_nearly_as_much(shared_data: Path) -> None:
    """Contrast and curve of the measured mask are its calibration, and the snapshots hardly need the mask at all."""
    captures = read_cassi(shared_data / "real" / "cassi_tsa")
    part = slice(272, 400)
    size = np.full((len(captures), 1, 1, 1), np.nan, np.float32)
    patterns, measurement = captures.patterns[:, part, part], captures.measurement[:, part, part]
    captures = replace(captures, patterns=patterns.copy(), measurement=measurement.copy(), scene=size)
    names = ("mask_blur", "mask_shift", "mask_contrast", "shot_noise", "read_noise")
    diagnosis = diagnose_blind(captures, {name: vocabulary()[name] for name in names})
    assert diagnosis.verdict == "undecided" and diagnosis.mask.visible
    assert diagnosis.mask.gained > 0.1 and not diagnosis.mask.decides
    assert {"mask_contrast", "mask_level_gamma"} == set(diagnosis.calibration) and not set(diagnosis.names) & {
        "mask_contrast",
        "mask_level_gamma",
    }
