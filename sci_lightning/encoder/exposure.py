"""One exposure in time: when the source shines, when each row is open, and the masks that follow from it."""

from __future__ import annotations

from dataclasses import dataclass

import torch

STEPS = 8
"""Steps into which a slot is divided, because a rolling shutter may open or shut a row within it."""


@dataclass(frozen=True)
class Exposure:
    """One exposure in time, counted in slots from the moment the first row opens.

    Attributes:
        slots: T.
        rows: H.
        power: ``(K, S)`` power of the source in every step of every slot, nominally 1; K >= T slots.
        open: ``(K, S, H)`` or a shape that broadcasts to it: the part of the step during which the row is open.
    """

    slots: int
    rows: int
    power: torch.Tensor
    open: torch.Tensor

    @staticmethod
    def ideal(slots: int, rows: int, like: torch.Tensor) -> Exposure:
        """Return an exposure with a steady source and all rows open from 0 to T."""
        ones = torch.ones(slots, STEPS, device=like.device, dtype=like.dtype)
        return Exposure(slots, rows, ones, ones[..., None])

    def times(self) -> torch.Tensor:
        """Return the middle of every step, ``(K, S)``, in slots."""
        count, steps = self.power.shape
        time = torch.arange(count * steps, device=self.power.device, dtype=self.power.dtype)
        return ((time + 0.5) / steps).view(count, steps)

    def mask(self, shown: torch.Tensor) -> torch.Tensor:
        """Return the transmittance that multiplies every frame over the whole exposure.

        Beyond the last slot the patterns continue cyclically, while the scene stays at its last frame.

        Args:
            shown: ``(U, T, H, W)`` transmittance of every slot; with cells, several lines per row of pixels.

        Returns:
            ``(U, T, H, W)`` transmittance that multiplies every frame.
        """
        weight = (self.power[..., None] * self.open).mean(1)[..., None]  # (K, H, 1)
        if weight.shape[1] > 1:
            weight = weight.repeat_interleave(shown.shape[-2] // self.rows, 1)
        last = self.slots - 1
        met = shown * weight[: self.slots]
        for slot in range(self.slots, len(weight)):
            late = shown[:, slot % self.slots] * weight[slot]
            met = torch.cat((met[:, :last], (met[:, last] + late)[:, None]), 1)
        return met
