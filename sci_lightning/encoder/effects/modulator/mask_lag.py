"""Mask lag: mirrors (or liquid crystals) settle slowly."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import ModulatorEffect


class MaskLag(ModulatorEffect):
    r"""The displayed pattern lags behind: :math:`D_t = (1 - l) M_t + l D_{t-1}`, with :math:`D_{-1} = M_{T-1}`.

    Args:
        lag: l, 0 to 0.99.
    """

    name = "mask_lag"
    rank = 14
    about = {"lag": Parameter("1", 0.0, 0, 0.99, step=0.01, starts=(0.1, 0.3))}
    sentence = "{lag} of every pattern stays on during the next slot"
    lag: torch.Tensor

    def schedule(self, slots: int) -> torch.Tensor:
        commanded = torch.eye(slots, device=self.lag.device)
        displayed, rows = commanded[-1], []
        for slot in range(slots):
            displayed = (1 - self.lag) * commanded[slot] + self.lag * displayed
            rows.append(displayed)
        return torch.stack(rows)
