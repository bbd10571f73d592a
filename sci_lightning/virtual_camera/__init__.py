"""A virtual camera with hidden effects, to test a diagnosis with.

:class:`VirtualCamera` takes and writes the captures, :class:`Session` says which ones. The camera itself is in
:mod:`sci_lightning.virtual_camera.hardware`, one module per part, in the order in which light passes them; a second
formulation, of an imperfect set-up, is in :mod:`sci_lightning.virtual_camera.rays`. Nothing here is
shared with :mod:`sci_lightning.encoder`.
"""

from __future__ import annotations

from sci_lightning.virtual_camera.hardware.vocabulary import DRAWN, EFFECTS, LATER, OTHER_FIELDS, OUTSIDE, VOCABULARY
from sci_lightning.virtual_camera.hidden_effects import choose_effects
from sci_lightning.virtual_camera.session import Acquisition, Session
from sci_lightning.virtual_camera.virtual_camera import Simulation, VirtualCamera

__all__ = [
    "DRAWN",
    "EFFECTS",
    "LATER",
    "OTHER_FIELDS",
    "OUTSIDE",
    "VOCABULARY",
    "Acquisition",
    "Session",
    "Simulation",
    "VirtualCamera",
    "choose_effects",
]
