"""Overlapping square blocks of an image: cutting them out, and blending estimates of them into one video."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch.nn import functional as F

LEAST_WEIGHT = 1e-3
"""Weight of a block's estimate at its corners; above 0, because at the image's corners no other block helps."""


@dataclass(frozen=True)
class BlockGrid:
    """A grid of blocks of ``block`` x ``block`` pixels, ``stride`` pixels apart, that covers an image ``(H, W)``.

    Images are padded by replication at the right and lower edge where the last blocks reach beyond it.

    Attributes:
        height, width: H and W in pixels.
        block: B, side of a block in pixels.
        stride: distance of neighbouring blocks in pixels, at most B.
    """

    height: int
    width: int
    block: int
    stride: int

    @property
    def rows(self) -> int:
        """The number of blocks from top to bottom."""
        return self._count(self.height)

    @property
    def columns(self) -> int:
        """The number of blocks from left to right."""
        return self._count(self.width)

    def _count(self, length: int) -> int:
        return 1 + max(0, math.ceil((length - self.block) / self.stride))

    def pad(self, image: torch.Tensor) -> torch.Tensor:
        """Return an image ``(C, H, W)`` with the rows and columns that the last blocks reach beyond it."""
        down, right = (
            (count - 1) * self.stride + self.block - length
            for count, length in ((self.rows, self.height), (self.columns, self.width))
        )
        return F.pad(image, (0, right, 0, down), mode="replicate") if down or right else image

    def cut(self, padded: torch.Tensor, first: int, last: int) -> torch.Tensor:
        """Return the blocks of some rows of a padded image ``(C, .., ..)``.

        Args:
            padded: what :meth:`pad` returned.
            first, last: numbers of the first row of blocks and of the one after the last.

        Returns:
            ``(C, blocks, B * B)``, row by row.
        """
        rows = padded[:, first * self.stride : (last - 1) * self.stride + self.block]
        blocks = rows.unfold(1, self.block, self.stride).unfold(2, self.block, self.stride)
        return blocks.flatten(3).flatten(1, 2)

    def window(self, device: torch.device | None = None) -> torch.Tensor:
        """Return the weights ``(B * B,)`` of a block's pixels in the blend: a raised cosine in both directions."""
        centres = (torch.arange(self.block, device=device) + 0.5) / self.block
        profile = torch.sin(math.pi * centres).square()
        return (profile[:, None] * profile).flatten() + LEAST_WEIGHT

    def add(self, blocks: torch.Tensor, rows: int) -> torch.Tensor:
        """Return the sum ``(N, C, .., ..)`` of blocks ``(N, C, B * B, blocks)``, of whole rows, at their places."""
        size = ((rows - 1) * self.stride + self.block, (self.columns - 1) * self.stride + self.block)
        return F.fold(blocks.flatten(1, 2), size, self.block, stride=self.stride)
