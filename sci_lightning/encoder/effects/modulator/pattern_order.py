"""Pattern order: the sequence of patterns starts some slots early or late."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.encoder.effects.stage import ModulatorEffect


class PatternOrder(ModulatorEffect):
    r"""Slot t displays the pattern commanded for slot t - offset, cyclically: :math:`D_t = M_{(t - o) \bmod T}`.

    Args:
        offset: o, whole slots, -64 to 64.
    """

    name = "pattern_order"
    rank = 10
    about = {"offset": Parameter("slots", 0, choices=tuple(range(-64, 65)))}
    sentence = "the patterns come {offset} slots late"
    offset: int

    @classmethod
    def starts(cls, frames: int, size: tuple[int, int], bit_depth: int) -> list[dict[str, Value]]:
        return [{"offset": step} for step in range(-((frames - 1) // 2), frames // 2 + 1) if step]

    def schedule(self, slots: int) -> torch.Tensor:
        return torch.eye(slots).roll(self.offset, 0)
