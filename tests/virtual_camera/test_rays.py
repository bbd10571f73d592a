"""Rays and closed-form integrals agree where nothing is imperfect, and imperfections have the size that is stated."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, VirtualCamera, choose_effects
from sci_lightning.virtual_camera.hardware.camera import Camera
from sci_lightning.virtual_camera.rays.ray_camera import FAULTLESS, Imperfections, RayCamera
from tests.virtual_camera.conftest import one_capture

SESSION = Session(size=(20, 16), frames=4, mask="binary", dark=0, flat=1, all_on=1, all_off=1, static=1, dynamic=1)
INPUT = SESSION.acquisition(2)
GEOMETRY = {"mask_shift": {"dx": 0.6, "dy": -0.35}, "mask_rotation": {"angle": 3.0}, "mask_scale": {"scale": 1.03}}
LENS = {"mask_keystone": {"tilt_x": 0.03, "tilt_y": -0.05}, "mask_distortion": {"k": -0.05}}
BLUR = {"mask_blur": {"sigma": 0.6}, "optical_blur": {"sigma": 0.5}, "ghost": {"fraction": 0.1, "dx": 3.0, "dy": -2.0}}
TIME = {
    "pattern_order": {"offset": 1},
    "mask_lag": {"lag": 0.2},
    "flicker": {"amplitude": 0.3, "frequency": 1.3, "phase": 0.4},
    "duty_cycle": {"fraction": 0.8},
    "rolling_shutter": {"delay": 1.2},
    "uneven_slots": {"std": 0.1, "course": 5},
}

SUBSLOTS = {"phased_reset": {"delay": 0.3}, "bit_planes": {"order": "msb_first"}}
FIELD = {"lateral_colour": {"spread": 0.03}, "field_blur": {"centre": 0.3, "corner": 1.0}}
LATE = {"sync_offset": {"offset": -0.3}}
"""Alone: beside a flicker, integrals take the mean of a slot, and instants see which pattern meets the bright part."""


def both(wish: dict[str, dict[str, float]], session: Session = SESSION) -> tuple[np.ndarray, np.ndarray]:
    """The light (N, H, W) by integrals and by rays without faults."""
    effects = choose_effects(wish, session, 2)
    acquisition = session.acquisition(2)
    return (
        Camera(session, effects, 2).irradiance(acquisition),
        RayCamera(session, effects, 2, FAULTLESS).irradiance(acquisition),
    )


def test_without_faults_an_aligned_mask_is_exact() -> None:
    integrated, sampled = both({})
    np.testing.assert_allclose(sampled, integrated, atol=1e-9)


@pytest.mark.parametrize(
    ("wish", "error"),
    [
        (GEOMETRY, 0.006),
        (LENS, 0.006),
        (TIME, 0.001),
        (LATE, 0.0005),
        ({**GEOMETRY, **BLUR}, 0.012),
        (SUBSLOTS, 0.0005),
        (FIELD, 0.01),
    ],
    ids=["geometry", "lens", "time", "late", "blur", "subslots", "field"],
)
@pytest.mark.parametrize(
    "surround", ["goes_on", *(pytest.param(one, marks=pytest.mark.slow) for one in ("dark", "edge"))]
)
def test_rays_and_integrals_agree(wish: dict[str, dict[str, float]], error: float, surround: str) -> None:
    session = replace(SESSION, surround=surround, mask="structural" if wish is SUBSLOTS else "binary")
    integrated, sampled = both(wish, session)
    nominal, _ = both({}, session)
    assert np.sqrt(np.mean((sampled - integrated) ** 2)) < error
    assert np.sqrt(np.mean((integrated - nominal) ** 2)) > 10 * error  # which the effects change much more
    assert abs((sampled - integrated).mean()) < error / 5


def test_a_mask_that_moves_far_has_no_border() -> None:
    integrated, sampled = both({"mask_shift": {"dx": 20.0}})
    assert np.sqrt(np.mean((sampled - integrated) ** 2)) < 1e-6


def test_gaps_between_mirrors() -> None:
    """Half a mirror further, a pixel sees both halves equally; a quarter further, a little less of the farther one."""
    coding = np.zeros((2, 16, 16))
    coding[:, :, 8] = 0.5
    session = Session(size=(16, 16), frames=2, surround="dark")
    effects = choose_effects({"mask_shift": {"dx": 0.25}}, session, 0)
    imperfect = replace(FAULTLESS, fill_factor=0.64, strata=64)
    light = RayCamera(session, effects, 0, imperfect).irradiance(one_capture(coding))[0]
    assert light[:, 8].mean() == pytest.approx(1 - 0.15 / 0.8, abs=0.002)  # 0.1 to 0.9 of the cell reflects
    assert light[:, 9].mean() == pytest.approx(0.15 / 0.8, abs=0.002)


def test_photon_transfer() -> None:
    """Variance is mean over full well, and the dark noise is the data sheet's, with the shot noise of dark current."""
    session = Session(
        size=(150, 150), frames=2, bit_depth=16, full_well_e=2000.0, read_noise_dn=100.0, formulation="rays"
    )
    camera = RayCamera(session, {}, 3, replace(FAULTLESS, dark_current_e=8.0))
    flat = one_capture(np.full((2, 150, 150), 0.5))
    for level in (0.1, 0.6):
        signal = camera.signal(np.full((1, 150, 150), level), flat, np.random.default_rng(0))
        assert signal.mean() == pytest.approx(level, abs=5e-4)
        assert signal.var() == pytest.approx(level / 2000 + (100 / 65535) ** 2, rel=0.03)
    longer = replace(flat, exposure=np.full(1, 50.0))
    dark = camera.signal(np.zeros((1, 150, 150)), longer, np.random.default_rng(0))
    assert dark.mean() == pytest.approx(0, abs=2e-4) and dark.var() > (49 * 8) / 2000**2  # dark current has shot noise


def test_pixels_differ_in_blotches() -> None:
    session = Session(size=(64, 64), frames=2, formulation="rays")
    transfer = RayCamera(session, {}, 3).photon_transfer
    assert transfer.response.std() == pytest.approx(0.005) and transfer.response.mean() == pytest.approx(1)
    assert transfer.offset_e.std() == pytest.approx(1.0) and abs(transfer.offset_e.mean()) < 1e-9
    for values in (transfer.response, transfer.offset_e):
        neighbours = np.corrcoef(values[:, 1:].ravel(), values[:, :-1].ravel())[0, 1]
        assert 0.3 < neighbours < 0.6
    hidden = choose_effects({"prnu": {"std": 0.02}}, session, 3)
    assert RayCamera(session, hidden, 3).photon_transfer.response.std() == 0


def test_lamp_and_prints() -> None:
    session = Session(size=(32, 32), frames=2, dark=0, flat=30, all_off=0, static=3, dynamic=3)
    acquisition = session.acquisition(1)
    kinds = np.array(acquisition.kind)
    ideal = Camera(session, {}, 1).irradiance(acquisition)
    jittery = RayCamera(session, {}, 1, replace(FAULTLESS, exposure_jitter=0.005)).irradiance(acquisition)
    powers = (jittery[kinds == "flat"] / ideal[kinds == "flat"]).mean((1, 2))
    assert 0.003 < powers.std() < 0.007
    printed = RayCamera(session, {}, 1, replace(FAULTLESS, print_error=0.01)).irradiance(acquisition)
    bright = ideal > 0.3
    error = {
        kind: (printed / np.maximum(ideal, 1e-9) - 1)[(kinds == kind)[:, None, None] & bright] for kind in set(kinds)
    }
    assert error["static"].std() == pytest.approx(0.01, rel=0.1)  # one print for both slots
    assert 0.005 < error["dynamic"].std() < 0.0095  # two prints, unequally lit
    assert np.abs(error["flat"]).max() < 1e-9


@pytest.mark.filterwarnings("error")
def test_a_power_law_of_pixels_whose_offset_is_negative() -> None:
    session = Session(size=(24, 24), frames=4, bit_depth=12, formulation="rays")
    simulation = VirtualCamera(session, {"response_gamma": {"gamma": 0.8}}).simulate(3)
    gain = simulation.truth().effects[0].log_likelihood_gain
    assert gain is not None and math.isfinite(gain)


def test_truth_of_an_imperfect_set_up() -> None:
    session = Session(size=(16, 16), frames=2, formulation="rays")
    simulation = VirtualCamera(session, {"gain": {"factor": 1.1}}).simulate(3)
    truth = simulation.truth()
    assert truth.as_json()["also_true"] == ("prnu",) and truth.effects[0].log_likelihood_gain > 1000
    other = VirtualCamera(replace(session, formulation="overlap"), {"gain": {"factor": 1.1}}).simulate(3)
    assert "also_true" not in other.truth().as_json() and (other.measurement != simulation.measurement).any()
    np.testing.assert_array_equal(other.stated_scene, simulation.stated_scene)  # the file says the same of both
    again = VirtualCamera(session, {"gain": {"factor": 1.1}}).simulate(3)
    np.testing.assert_array_equal(again.measurement, simulation.measurement)


def test_a_wrong_datasheet() -> None:
    session = Session(size=(16, 16), frames=2, datasheet_factor=2.0)
    simulation = VirtualCamera(session).simulate(3)
    captures = simulation.captures()
    assert (captures.read_noise_dn, captures.full_well_e) == (1.6, 20000.0)
    assert simulation.truth().noise.full_well_e == 10000.0
    assert simulation.truth().also_true == ("shot_noise", "read_noise")


def test_no_such_formulation() -> None:
    with pytest.raises(BadInput, match="overlap or rays, got 'wave'"):
        Session(formulation="wave")
    assert Imperfections().fill_factor == 0.92
