"""Learned structural mask of 1 bit, one index per pixel."""

from __future__ import annotations

from typing import Any

import torch

from sci_lightning.encoder.mask.learned_one_bit import LearnedOneBit
from sci_lightning.encoder.mask.structure import uniform


class LearnedIndex(LearnedOneBit):
    """One real value u in [0, 1] per pixel is learned; the pixel is open in slot min(floor(T u), T - 1) alone.

    The released code of the paper means its masks of 1 bit so, where
    :class:`~sci_lightning.encoder.mask.LearnedStructural` opens the brightest of T values. The gradient is the released
    one: with g_t that of slot t's transmittance, u gets - sum over t of g_t, each clamped to [-1, 1].

    The published start is uniform in [0, 1), a random slot in every pixel; the designed one is the mask that
    :func:`~sci_lightning.encoder.mask.design.design_structural` finds in seconds.

    Args: see :class:`~sci_lightning.encoder.mask.learned_one_bit.LearnedOneBit`.

    Source: the code of "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), mode ``binary_sparse``, which
    its training calls by another name and so never reaches.
    """

    def first_values(self, seed: int, designed: bool) -> torch.Tensor:
        if designed:
            return (self.designed(1, True, seed).argmax(0) + 0.5) / self.frames  # the middle of the slot's range
        return uniform(self.pattern_shape[1:], seed)

    def forward(self) -> torch.Tensor:
        return self.cover(_OpenSlot.apply(self.weight, self.frames))


class _OpenSlot(torch.autograd.Function):
    """Values ``(h, w)`` in [0, 1] to a mask ``(T, h, w)`` of 0 and 1, one slot open in every pixel."""

    @staticmethod
    def forward(ctx: Any, values: torch.Tensor, frames: int) -> torch.Tensor:
        index = (frames * values).floor().clamp(0, frames - 1).long()
        return torch.zeros(frames, *values.shape, device=values.device).scatter_(0, index[None], 1.0)

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, None]:
        return -gradients[0].clamp(-1, 1).sum(0), None
