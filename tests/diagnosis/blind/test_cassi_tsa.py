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
def test_the_mask_is_softer_than_in_its_file(shared_data: Path) -> None:
    """Its contrast and curve are its calibration, and a camera without any mask explains most of what is gained.

    A displacement by half a pixel softens a mask nearly as a blur does: one of the two is named, the other one is among
    its alternatives.
    """
    captures = read_cassi(shared_data / "real" / "cassi_tsa")
    part = slice(272, 400)
    size = np.full((len(captures), 1, 1, 1), np.nan, np.float32)
    patterns, measurement = captures.patterns[:, part, part], captures.measurement[:, part, part]
    captures = replace(captures, patterns=patterns.copy(), measurement=measurement.copy(), scene=size)
    names = ("mask_blur", "mask_shift", "mask_contrast", "shot_noise", "read_noise")
    diagnosis = diagnose_blind(captures, {name: vocabulary()[name] for name in names})
    assert len(diagnosis.effects) == 1 and diagnosis.mask.visible and diagnosis.verdict == "undecided"
    assert {"mask_blur", "mask_shift"} <= {diagnosis.effects[0].name, *diagnosis.effects[0].alternatives}
    assert diagnosis.calibration.keys() == {"mask_contrast", "mask_level_gamma"}
    assert 0.6 * diagnosis.mask.gained < diagnosis.mask.gained_without < diagnosis.mask.gained
