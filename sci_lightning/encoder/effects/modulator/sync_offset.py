"""Synchronisation offset: the mirrors switch a part of a slot late or early."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect


class SyncOffset(ModulatorEffect):
    r"""A part of every slot shows its neighbour: :math:`D_t = (1 - o) M_t + o M_{t-1}`, cyclically.

    If mirrors switch early (o < 0), the neighbour is the next pattern: :math:`D_t = (1 - |o|) M_t + |o| M_{t+1}`. An
    offset of whole slots is the effect ``pattern_order``.

    Args:
        offset: o, slots, -0.5 to 0.5; positive: late.
    """

    name = "sync_offset"
    rank = 15
    about = {"offset": Parameter("slots", 0.0, -0.5, 0.5, step=0.01, starts=(-0.25, 0.25))}
    sentence = "patterns come {offset} slots late (below 0: early)"
    offset: torch.Tensor

    def schedule(self, slots: int) -> torch.Tensor:
        own = torch.eye(slots, device=self.offset.device)
        late, early = self.offset.clamp(min=0), (-self.offset).clamp(min=0)
        return (1 - late - early) * own + late * own.roll(1, 0) + early * own.roll(-1, 0)
