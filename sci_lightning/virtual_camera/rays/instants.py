"""The exposure as a row of instants: what the mirrors display, how the lamp shines and which rows are open.

The other formulation multiplies the mean light of a slot by what is displayed in the slot on average. Here a pattern
that comes late meets the light of the moments at which it is displayed.
"""

from __future__ import annotations

import math

import numpy as np

from sci_lightning.virtual_camera.hardware.exposure import Timing

INSTANTS = 1000
"""Random instants in every slot, one in each thousandth of it."""


def slot_shares(
    timing: Timing, displayed: np.ndarray, late: float, rows: int, random: np.random.Generator
) -> np.ndarray:
    """Return how much light of every frame of the scene passes every commanded pattern, row by row.

    Args:
        timing: the lamp, the shutter and the part of a slot during which the mirrors are lit.
        displayed: (T, T) what the mirrors have made of the commanded patterns: the share of every one of them in what
            they display in turn.
        late: slots by which the mirrors switch late, cyclically; negative for early.
        rows: H, rows of the sensor.
        random: source of the instants.

    Returns:
        (H, T, T): row, commanded slot, frame of the scene; 1 where the slot of a pattern is that of the frame.
    """
    slots = len(displayed)
    last = slots + math.ceil(timing.delay)
    time = (np.arange(last * INSTANTS) + random.random(last * INSTANTS)) / INSTANTS
    slot = time.astype(int)
    into = time - slot
    lamp = 1 + timing.amplitude * np.sin(2 * np.pi * timing.frequency * time / slots + timing.phase)
    lit = (into < timing.duty) & ((slot % slots != timing.slot) | (into < 1 - timing.loss))
    lamp = np.maximum(lamp, 0) * lit * timing.slot_levels(slots)[slot % slots]
    opens = timing.delay * np.arange(rows) / max(rows - 1, 1)
    exposed = (time >= opens[:, None]) & (time < opens[:, None] + slots)
    shows = displayed[np.floor(time - late).astype(int) % slots]
    frame = np.minimum(slot, slots - 1)
    shares = np.zeros((rows, slots, slots))
    for number in range(slots):
        during = frame == number
        shares[:, :, number] = (exposed[:, during] * lamp[during]) @ shows[during] / INSTANTS
    return shares


def settled(order: int, lag: float, slots: int) -> np.ndarray:
    """Return the share (T, T) of every commanded pattern in what the mirrors display in turn.

    The mirrors are followed slot by slot: in each they forget all but ``lag`` of what they displayed before, beginning
    with the pattern of the last slot.

    Args:
        order: slots by which the sequence starts late.
        lag: part of the slot before that is still displayed.
        slots: T.
    """
    commanded = np.eye(slots)[(np.arange(slots) - order) % slots]
    now = commanded[-1]
    course = []
    for target in commanded:
        now = now + (1 - lag) * (target - now)
        course.append(now)
    return np.array(course)
