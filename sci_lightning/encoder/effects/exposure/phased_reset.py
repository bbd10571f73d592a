"""Phased reset: blocks of the modulator's rows change their patterns one after the other."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ExposureEffect

BLOCKS = 16
"""Blocks of rows that are reset together, as on common digital micromirror devices."""


class PhasedReset(ExposureEffect):
    r"""Block b of the modulator's rows, b = 0 to 15 from the first row, changes :math:`d_b = \tau b / 15` slots late.

    It displays :math:`(1 - d_b) M_t + d_b M_{t-1}` in slot t, cyclically. Neglected is that the pattern before meets
    the beginning of the slot: scene and light are those of the whole slot. The blocks are mirrors, and are imaged as
    the patterns are.

    Args:
        delay: tau, slots between the first and the last block, 0 to 1.
    """

    name = "phased_reset"
    rank = 35
    about = {"delay": Parameter("slots", 0.0, 0, 1, step=0.01, starts=(0.1, 0.4))}
    sentence = "the last rows of the modulator change their pattern {delay} slots after the first"
    delay: torch.Tensor

    def retimed(self, patterns: torch.Tensor) -> torch.Tensor:
        rows = patterns.shape[-2]
        block = torch.arange(rows, device=patterns.device) * BLOCKS // rows
        return patterns * (1 - block / (BLOCKS - 1))[:, None]

    def retiming(self, slots: int) -> torch.Tensor:
        own = torch.eye(slots, device=self.delay.device)
        return self.delay * (own - own.roll(1, 0))
