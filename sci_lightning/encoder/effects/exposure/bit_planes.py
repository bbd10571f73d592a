"""Bit planes: gray levels are displayed as binary planes, one after the other within the slot."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ExposureEffect
from sci_lightning.encoder.signal import Signal
from sci_lightning.files.modulator_files import LARGEST_BITS, display_times

ROUNDING = 1e-3
"""Levels by which a value may differ from a whole level: single precision is right to 2e-5 of 255 levels."""


class BitPlanes(ExposureEffect):
    r"""Plane k of b bits is displayed for the part :math:`2^k / (2^b - 1)` of the slot, the planes one after another.

    The frame :math:`x_t` of a slot is the mean of the scene over it. Within the slot, the scene changes linearly by
    :math:`g_t = (x_{t+1} - x_{t-1}) / 2`, at either end by the difference from the only neighbour. A plane whose middle
    is :math:`c_k` slots after that of the slot meets :math:`x_t + c_k g_t`, so that

    .. math:: y = \sum_t M_t x_t + N_t g_t, \quad N_t = \sum_k c_k M_{tk},

    where :math:`M_{tk}` is what plane k adds to the level :math:`M_t`. Binary patterns and scenes at rest do not
    change; nor do values that are no levels of 1 to 8 bits (multiples of 1 / 2^b or 1 / (2^b - 1)), such as those of a
    measured mask. What multiplies a frame may be a little less than 0; light that would be is 0. Neglected are changes
    of the source within the slot.

    Args:
        order: ``msb_first`` or ``lsb_first``, the plane of the most or the least significant bit first; ``none``: gray
            levels without planes.
    """

    name = "bit_planes"
    rank = 36
    about = {"order": Parameter("", "none", choices=("none", "msb_first", "lsb_first"))}
    sentence = "gray levels are displayed as bit planes one after the other ({order}), between which the scene moves"
    order: str

    def retimed(self, patterns: torch.Tensor) -> torch.Tensor:
        levels = None if self.order == "none" else gray_levels(patterns.detach())
        if levels is None:
            return patterns
        level, bits, full = levels
        moved = patterns
        for bit, start, stop in display_times(bits, self.order):
            moved = moved + ((level >> bit) & 1) * ((start + stop - 1) / 2 * 2**bit / full)
        return moved

    def retiming(self, slots: int) -> torch.Tensor:
        own = torch.eye(slots)
        return torch.gradient(own, dim=0)[0].T if slots > 1 and self.order != "none" else 0 * own

    def form(self, signal: Signal) -> Signal:
        return signal if self.order == "none" else signal.with_mean(signal.mean.clamp(min=0))


def gray_levels(patterns: torch.Tensor) -> tuple[torch.Tensor, int, int] | None:
    """Return whole levels of patterns in [0, 1], their bits, and the level that means 1; None if they have no such.

    A value of 1 that is no level of its own is the largest level, all of whose bits are set.
    """
    for bits in range(1, LARGEST_BITS + 1):
        for full in (2**bits, 2**bits - 1):
            level = (patterns * full).round()
            if bool(((patterns * full - level).abs() < ROUNDING).all()):
                return level.clamp(0, 2**bits - 1).int(), bits, full
    return None
