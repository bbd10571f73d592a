"""One exposure in time: when the source shines, when each row looks, and what that makes of the masks."""

from __future__ import annotations

from dataclasses import dataclass

import torch

STEPS = 8
"""Steps in which the course of a slot is followed, where a rolling shutter cuts it."""


@dataclass(frozen=True)
class Exposure:
    """The course of one exposure, in slots from the moment the first row opens.

    Attributes:
        slots: T.
        rows: H.
        power: ``(K, S)`` of the source in every step of every slot, 1 when all is in order; K >= T slots.
        open: ``(K, S, H)`` or one that broadcasts to it: the part of the step during which the row looks.
    """

    slots: int
    rows: int
    power: torch.Tensor
    open: torch.Tensor

    @staticmethod
    def ideal(slots: int, rows: int, like: torch.Tensor) -> Exposure:
        """A steady source, and all rows looking from 0 to T."""
        ones = torch.ones(slots, STEPS, device=like.device, dtype=like.dtype)
        return Exposure(slots, rows, ones, ones[..., None])

    def times(self) -> torch.Tensor:
        """``(K, S)``: the middle of every step, in slots."""
        count, steps = self.power.shape
        time = torch.arange(count * steps, device=self.power.device, dtype=self.power.dtype)
        return ((time + 0.5) / steps).view(count, steps)

    def mask(self, shown: torch.Tensor) -> torch.Tensor:
        """What each frame meets in all.

        Patterns go on cyclically beyond the last slot, while the scene's last frame is held.

        Args:
            shown: ``(U, T, H, W)`` transmittance of every slot; several lines a row, in order, if they are finer.

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
