"""Mask lag: mirrors (or liquid crystals) settle slowly."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect


class MaskLag(ModulatorEffect):
    r"""What is displayed trails behind: :math:`D_t = (1 - l) M_t + l D_{t-1}`, with :math:`D_{-1} = M_{T-1}`.

    Args:
        lag: l, 0 to 0.99.
    """

    name = "mask_lag"
    rank = 14
    about = {"lag": Parameter("1", 0.0, 0, 0.99, step=0.01, starts=(0.1, 0.3))}
    sentence = "{lag} of every pattern stays on during the next slot"
    lag: torch.Tensor

    def schedule(self, slots: int) -> torch.Tensor:
        told = torch.eye(slots, device=self.lag.device)
        before, rows = told[-1], []
        for slot in range(slots):
            before = (1 - self.lag) * told[slot] + self.lag * before
            rows.append(before)
        return torch.stack(rows)
