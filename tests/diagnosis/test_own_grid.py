"""Diagnoses of captures whose patterns are on the modulator's own grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.captures import read_captures, write_captures
from sci_lightning.configuration.build import build
from sci_lightning.diagnosis import diagnose
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.report.corrected_camera import encoder_of
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.effects import MaskShift
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.errors import BadInput
from sci_lightning.runs.encoder_file import read_encoder_file
from tests.own_grid_camera import Deviation, captures, homography, image

SIZE, MIRRORS = (32, 40), (40, 44)
NEIGHBOURS = ("mask_shift", "mask_rotation", "mask_contrast", "gain", "shot_noise", "read_noise")
WIDE = homography((1.6, 1.2), 2.0, size=SIZE, mirrors=MIRRORS)


@pytest.mark.slow
def test_a_displaced_mask_behind_a_homography(tmp_path: Path) -> None:
    """Its name, its values and its encoder are right; the test below takes every effect."""
    write_captures(tmp_path / "a.h5", captures(WIDE, Deviation(shift=(0.6, -0.35)), SIZE, MIRRORS))
    few = {name: effect for name, effect in vocabulary().items() if name in NEIGHBOURS}
    result = diagnose(read_captures(tmp_path / "a.h5"), few)
    assert result.names == ("mask_shift",)
    assert result.after.gap.chi2 < 1.06 and result.before.gap.chi2 > 5
    for name, value in (("dx", 0.6), ("dy", -0.35)):
        (effect,) = result.effects
        error = float(effect.parameters[name].value) - value
        assert abs(error) < 0.02, (name, error)
    result.save(tmp_path / "found")
    encoder = build(read_encoder_file(tmp_path / "found" / "encoder.yaml").content, "encoder")
    assert encoder.size == SIZE and encoder.mask.size == MIRRORS
    expected = image(result.observation.patterns[:4].numpy(), WIDE, SIZE, Deviation(shift=(0.6, -0.35)), beyond=0.0)
    inner = (slice(None), slice(3, -3), slice(3, -3))
    error = encoder.transmittance().detach().numpy()[inner] - expected[inner]
    assert np.sqrt((error**2).mean()) < 0.03
    assert encoder(torch.rand(1, 4, *SIZE)).shape == (1, *SIZE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("deviation", "names"),
    [
        (Deviation(), ()),
        (Deviation(shift=(0.6, -0.35)), ("mask_shift",)),
        (Deviation(angle=0.7), ("mask_rotation",)),
        (Deviation(scale=1.02), ("mask_scale",)),
        (Deviation(barrel=-0.04), ("mask_distortion",)),
        (Deviation(tilt=(0.03, 0.02)), ("mask_keystone",)),
        (Deviation(shift=(0.4, 0.2), barrel=0.03), ("mask_shift", "mask_distortion")),
    ],
    ids=str,
)
@pytest.mark.parametrize(
    "matrix",
    [WIDE, homography((5.2, 2.6), size=SIZE, mirrors=MIRRORS), homography((1.0, 1.0), 45.0, SIZE, (70, 70))],
    ids=["turned", "diamond array", "at 45 degrees"],
)
def test_deviations_behind_a_homography(matrix: np.ndarray, deviation: Deviation, names: tuple[str, ...]) -> None:
    mirrors = (70, 70) if matrix[0, 1] > 0.5 else MIRRORS
    result = diagnose(captures(matrix, deviation, SIZE, mirrors, seed=3))
    assert set(result.names) == set(names) and result.after.gap.chi2 < 1.08
    assert result.verdict == ("explained" if names else "consistent")


def test_snapshots_of_unknown_scenes_are_seen_through_it() -> None:
    snapshots = captures(WIDE, size=SIZE, mirrors=MIRRORS, known=False).take(range(12, 18))
    observation = observe_snapshots(snapshots)
    moved = encoder_of(observation, LightPath([MaskShift(dx=0.6, dy=-0.35)]))
    patterns = observation.patterns[observation.sequences[observation.sequence.mode().values]]
    expected = image(patterns.numpy(), WIDE, SIZE, Deviation(shift=(0.6, -0.35)))
    assert moved.size == SIZE and np.sqrt(((moved.transmittance().numpy() - expected) ** 2).mean()) < 0.03


def test_patterns_that_nobody_registered() -> None:
    with pytest.raises(BadInput, match="captures register finds it"):
        diagnose(captures(WIDE, size=SIZE, mirrors=MIRRORS, sensor_to_modulator=None))
