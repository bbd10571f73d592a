"""Learned structural mask of 1 bit, one index per pixel."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Seed, Size
from sci_lightning.encoder.mask.mask import Mask, Start, check_start
from sci_lightning.encoder.mask.structure import check_binary, uniform


class LearnedIndex(Mask):
    """One real value u in [0, 1] per pixel is learned; the pixel is open in slot min(floor(T u), T - 1) alone.

    The released code of the paper means its masks of 1 bit so, where
    :class:`~sci_lightning.encoder.mask.LearnedStructural` opens the brightest of T values. The gradient is the released
    one: with g_t that of slot t's transmittance, u gets - sum over t of g_t, each clamped to [-1, 1].

    Args:
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the first values, uniform in [0, 1): a random slot in every pixel.
        bits: mask bit depth, always 1: it is there so that a sweep over bits can name every mask.
        start: see :class:`~sci_lightning.encoder.mask.LearnedStructural`.

    Raises:
        BadInput: ``bits`` other than 1.

    Source: the code of "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), mode ``binary_sparse``, which
    its training calls by another name and so never reaches.
    """

    learned = True

    def __init__(
        self,
        frames: Frames,
        size: Size,
        tile: Size | None = None,
        seed: Seed = 0,
        bits: Bits = 1,
        repeat: Pixels = 1,
        start: Start = "published",
    ) -> None:
        super().__init__(frames, size, tile, repeat)
        self.bits = check_binary(bits)
        if check_start(start):
            first = (self.designed(1, True, seed).argmax(0) + 0.5) / frames  # the middle of the slot's range
        else:
            first = uniform(self.pattern_shape[1:], seed)
        self.weight = nn.Parameter(first)

    @torch.no_grad()
    def project_(self) -> None:
        """Clamp the real values to [0, 1]; call after every optimiser step."""
        self.weight.clamp_(0, 1)

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
