"""The two formulations of the virtual camera's physics."""

from __future__ import annotations

from collections.abc import Mapping

from sci_lightning.virtual_camera.hardware.camera import Camera
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.rays.ray_camera import RayCamera
from sci_lightning.virtual_camera.session import Session

CAMERAS: dict[str, type[Camera]] = {"overlap": Camera, "rays": RayCamera}
"""The camera of every formulation, by the name that a session gives it."""


def build_camera(session: Session, effects: Mapping[str, Effect], seed: int) -> Camera:
    """Return the session's camera with the hidden effects in it and the maps of the seed."""
    return CAMERAS[session.formulation](session, effects, seed)
