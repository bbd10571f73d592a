"""A virtual camera with hidden effects, to prove a diagnosis with.

Physics from light to numbers in NumPy: touching square mirrors imaged in closed form, photons that are counted, a
converter that rounds. It shares no code with the encoder that is to be diagnosed, so that a mistake made there is not
made here as well.

    captures = capture_session(Session(size=(64, 64)), {"mask_shift": {"dx": 0.61, "dy": -0.35}}, seed=3)
    write_captures("captures.h5", captures)      # and captures.truth.json, for after the diagnosis
"""

from sci_lightning.virtual_camera.captures import Captures, capture_session, write_captures
from sci_lightning.virtual_camera.choice import choose
from sci_lightning.virtual_camera.hardware.camera import VirtualCamera
from sci_lightning.virtual_camera.hardware.vocabulary import EFFECTS, OUTSIDE, VOCABULARY
from sci_lightning.virtual_camera.session import Session
from sci_lightning.virtual_camera.shots import Shots

__all__ = [
    "EFFECTS",
    "OUTSIDE",
    "VOCABULARY",
    "Captures",
    "Session",
    "Shots",
    "VirtualCamera",
    "capture_session",
    "choose",
    "write_captures",
]
