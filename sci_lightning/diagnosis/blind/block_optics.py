"""What the optics do to a block of a snapshot: how much of the light around it falls on each of its pixels."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.blind.prior import BLOCK
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.encoder.effects import OpticsEffect
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.signal import Signal

REACH = 2
"""Pixels around a block from which the optics bring light into it; what comes from further away counts as even."""
WINDOW = 33
"""Side in pixels of the image on which the optics are probed."""
LEAST_SPREAD = 1e-5
"""Part of a pixel's light below which it counts as staying there."""


def optics_of_blocks(path: LightPath, observation: Observation) -> tuple[torch.Tensor | None, float]:
    """Return how much of the light of every pixel around a block falls on every pixel of it, ``(n, m)``.

    It is None where the light of every pixel stays there. The other figure is the part of the light that is spread
    over the whole field, which the matrix leaves out. Both are read off the images of single bright pixels.
    """
    effects = path.of(OpticsEffect)
    if not effects:
        return None, 0.0
    side = BLOCK + 2 * REACH
    inner = (WINDOW - side) // 2
    impulses = torch.zeros(side * side, WINDOW, WINDOW)
    places = torch.arange(side * side)
    impulses[places, inner + places // side, inner + places % side] = 1
    size = observation.size
    origin = (size[0] - WINDOW) // 2, (size[1] - WINDOW) // 2
    signal = Signal(impulses, torch.zeros(()), torch.ones(1, 1, 1), 1 / observation.full_scale, origin, size)
    for effect in effects:
        signal = effect.form(signal)
    first = inner + REACH
    formed = signal.mean[:, first : first + BLOCK, first : first + BLOCK]
    faintest = float(signal.mean[side * side // 2].min())  # far from the impulse: what is there is everywhere
    everywhere = faintest * WINDOW**2
    operator = (formed.flatten(1).mT.double() - faintest) / (1 - everywhere)
    own = impulses[:, first : first + BLOCK, first : first + BLOCK].flatten(1).mT
    stays = bool((operator - own).abs().max() < LEAST_SPREAD)
    return None if stays else operator, everywhere
