"""Displacements of the mask's image by many pixels are found in snapshots of unknown scenes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
from sci_lightning.diagnosis.blind.displacement import proposed_displacements
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import ScenePrior
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Setting, datasheet_noise
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera

SHARE = 0.375


def snapshots(hidden: dict[str, Any], mask: str = "binary", surround: str = "goes_on") -> Captures:
    """Return snapshots of moving scenes, 48 x 48 pixels and four slots."""
    silent = {"dark": 0, "flat": 0, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 0}
    session = Session(**silent, size=(48, 48), frames=4, mask=mask, unknown=6, aperture=0.28, surround=surround)
    return VirtualCamera(session, hidden).capture(seed=5)


def proposed(captures: Captures) -> list[Setting]:
    observation = observe_snapshots(captures)
    likelihood = BlindLikelihood(CameraModel(observation, vocabulary(), {}), ScenePrior(observation.frames))
    found = proposed_displacements(likelihood, datasheet_noise(observation)[0], SHARE)
    assert set(found) == {"mask_shift"}
    return found["mask_shift"]


@pytest.mark.parametrize("displacement", [(7.3, -5.6), (-11.2, 9.4), (0.3, 0.2)])
def test_correlation_leads_to_within_a_pixel(displacement: tuple[float, float]) -> None:
    """A blur and an offset of the sensor beside it change nothing, nor does the brightness of the snapshots."""
    dx, dy = displacement
    hidden = {"mask_shift": {"dx": dx, "dy": dy}, "mask_blur": {"sigma": 0.8}, "black_level": {"offset": 0.03}}
    starts = proposed(snapshots(hidden))
    assert len(starts) <= 8
    assert min(np.hypot(float(start["dx"]) - dx, float(start["dy"]) - dy) for start in starts) < 0.75


def test_a_grid_where_the_sum_of_the_patterns_is_even() -> None:
    starts = proposed(snapshots({}, mask="structural"))
    assert len(starts) == 64
    assert max(abs(float(start["dx"])) for start in starts) == 3.5


@pytest.mark.slow
def test_a_far_displacement_beside_an_offset_in_a_dark_surround() -> None:
    """What is dark beyond the patterns shows the offset alone, which nobody knows at first."""
    hidden = {"mask_shift": {"dx": 4.4, "dy": -3.3}, "black_level": {"offset": 0.05}}
    captures = snapshots(hidden, surround="dark")
    assert captures.surround == "dark"
    whole, names = vocabulary(), ("mask_shift", "mask_contrast", "black_level", "gain")
    result = diagnose_blind(captures, {name: whole[name] for name in names})
    assert set(result.names) == {"mask_shift", "black_level"}
    found = {name: one.value for effect in result.effects for name, one in effect.parameters.items()}
    assert found["dx"] == pytest.approx(4.4, abs=0.1) and found["dy"] == pytest.approx(-3.3, abs=0.1)
    assert found["offset"] == pytest.approx(0.05, abs=0.01)
