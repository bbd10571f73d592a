"""A small camera and what is put before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import pytest

from sci_lightning.virtual_camera import Acquisition, Session, choose_effects
from sci_lightning.virtual_camera.hardware.camera import Camera

SMALL = Session(size=(32, 32), frames=4, flat=2, all_on=1, all_off=1, dark=2, static=2, dynamic=2)


Signal: TypeAlias = Callable[..., np.ndarray]


@pytest.fixture
def signal() -> Signal:
    """``signal(acquisition, mask_shift={"dx": 1})``: what reaches the converter, (N, H, W), without noise."""

    def without_noise(
        acquisition: Acquisition, *, session: Session = SMALL, **wish: dict[str, float | str]
    ) -> np.ndarray:
        session = replace(session, size=acquisition.patterns.shape[1:], frames=acquisition.sequence.shape[1])
        effects = choose_effects(wish, session, 0)
        camera = Camera(session, effects, 0)
        return camera.signal(camera.irradiance(acquisition), acquisition)

    return without_noise


def one_capture(coding: np.ndarray, scene: np.ndarray | float = 1.0, *, exposure: float = 1.0) -> Acquisition:
    """One capture: T coding patterns (T, H, W) in their order, before a scene (T, H, W) or an even one."""
    video = np.broadcast_to(np.float32(scene), coding.shape)[None]
    sequence = np.arange(len(coding))[None]
    return Acquisition(coding, sequence, video, np.ones(1), np.full(1, exposure), ("unknown",))


def one_mirror(row: int = 8, column: int = 5, size: tuple[int, int] = (16, 16)) -> Acquisition:
    """Two slots in which a single mirror shows half of the light."""
    coding = np.zeros((2, *size))
    coding[:, row, column] = 0.5
    return one_capture(coding)
