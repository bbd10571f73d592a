"""Noise has the statistics of photons and amplifiers, and the converter rounds and clips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sci_lightning.virtual_camera import Session, VirtualCamera, choose_effects
from sci_lightning.virtual_camera.hardware.camera import Camera
from tests.virtual_camera.conftest import one_capture

DEEP = Session(size=(200, 200), frames=2, bit_depth=16, full_well_e=2000.0, read_noise_dn=0.0)


def recorded(session, level, **wish):
    camera = Camera(session, choose_effects(wish, session, 0), 3)
    return camera.record(one_capture(np.full((2, *session.size), level / 2))).astype(float) / camera.full_scale


@pytest.mark.parametrize("level", [0.05, 0.8])
def test_photons(level):
    grey = recorded(DEEP, level)
    assert grey.mean() == pytest.approx(level, rel=0.01)
    assert grey.var() == pytest.approx(level / 2000, rel=0.03)
    other = recorded(DEEP, level, shot_noise={"full_well": 500})
    assert other.var() == pytest.approx(level / 500, rel=0.03)
    brighter = recorded(DEEP, level, gain={"factor": 1.1})  # more photons, not more amplification
    assert brighter.var() == pytest.approx(1.1 * level / 2000, rel=0.03)


def test_few_photons_are_counted_whole() -> None:
    electrons = recorded(replace(DEEP, full_well_e=100.0), 0.03) * 100
    np.testing.assert_allclose(electrons, np.round(electrons), atol=1e-2)


def test_read_noise_is_in_dn_and_the_dark_is_clipped() -> None:
    session = Session(size=(200, 200), frames=2, read_noise_dn=1.5)
    dark = recorded(session, 0.0) * 255
    assert dark.min() == 0 and (dark == 0).mean() == pytest.approx(0.63, abs=0.01)  # P(1.5 z < 0.5)
    lifted = recorded(session, 0.0, black_level={"offset": 20 / 255}) * 255
    assert lifted.var() == pytest.approx(1.5**2 + 1 / 12, rel=0.03)
    louder = recorded(session, 0.0, black_level={"offset": 20 / 255}, read_noise={"std": 3.0}) * 255
    assert louder.var() == pytest.approx(9 + 1 / 12, rel=0.03)


def test_wells_that_are_full_do_not_flicker() -> None:
    full = recorded(replace(DEEP, read_noise_dn=0.0), 0.9, saturation={"level": 0.5})
    assert full.std() == 0 and full[0, 0, 0] == pytest.approx(0.5, abs=1e-4)


def test_effective_bits() -> None:
    session = Session(size=(64, 64), frames=2)
    ramp = np.linspace(0, 0.5, 64 * 64).reshape(1, 64, 64).repeat(2, 0)
    camera = Camera(session, choose_effects({"bit_depth": {"bits": 6}}, session, 0), 0)
    codes = np.unique(camera.record(one_capture(ramp), noise=False))
    assert len(codes) == 64 and codes[0] == 0 and codes[-1] == 255


def test_a_session_is_one_seed() -> None:
    session = Session(size=(24, 24), frames=4)
    first, again = (VirtualCamera(session, "random").simulate(5) for _ in range(2))
    np.testing.assert_array_equal(first.measurement, again.measurement)
    assert first.effects == again.effects
    other = VirtualCamera(session, "random").simulate(6)
    assert (first.measurement != other.measurement).any()
    ideal = VirtualCamera(session).simulate(5)  # what is hidden changes neither patterns nor scenes
    np.testing.assert_array_equal(first.acquisition.scene, ideal.acquisition.scene)
    np.testing.assert_array_equal(first.acquisition.patterns, ideal.acquisition.patterns)
