"""Motion-compensated temporal filtering: every frame borrows from its neighbours, along the motion."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import torch
from annotated_types import Interval
from torch import nn
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Pixels, Reach, Repeats
from sci_lightning.errors import BadInput

SMOOTH = 3
"""Side of the box that takes the edge off noise before blocks are compared .."""

SAMPLED = 2
""".. and of how many rows and columns one is enough to compare them then."""


class Path(NamedTuple):
    """To a neighbouring frame."""

    here: slice
    """Frames from which it leads .."""
    there: slice
    """.. to these."""
    pixel: torch.Tensor
    """``(N, frames, H * W)``: number of the pixel there."""
    weight: torch.Tensor
    """``(N, frames, H, W)``: 1 where it is like the pixel here, towards 0 where not."""


class MotionFilter(nn.Module):
    """Every pixel becomes the mean of itself and of where its block is found in neighbouring frames, by likeness.

    For every block of a frame the displacement with the smallest mean square difference is looked for in each of the
    ``frames`` frames before and after it; the difference d^2 gives that frame the weight exp(-d^2 / 2 deviation^2),
    so that what has no match stays as it is. Blocks overlap by half on every side when compared. Videos of one batch
    do not mix; gradients flow through the mean, not through the search.

    Args:
        frames: neighbours before and after.
        reach: how far a block is looked for in rows and columns, in pixels.
        block: side of the blocks that move together, in pixels; a multiple of 4.
        deviation: how unlike blocks may be, in units of the video.
        after: calls before the first search, while the video is too rough to be searched ..
        every: .. and how many calls a search serves; :meth:`reset` ends it early.

    Raises:
        BadInput: a number out of these ranges.

    Source: Dubois and Sabri, "Noise reduction in image sequences using motion-compensated temporal filtering", IEEE
    Trans. Communications 1984; the weights are those of non-local means (Buades, Coll and Morel, CVPR 2005).
    """

    def __init__(
        self,
        frames: Reach = 2,
        reach: Reach = 6,
        block: Pixels = 8,
        deviation: float = 0.03,
        after: Annotated[int, Interval(ge=0, le=10**9)] = 10,
        every: Repeats = 10,
    ) -> None:
        super().__init__()
        for name, value, least in (
            ("frames", frames, 1),
            ("reach", reach, 0),
            ("after", after, 0),
            ("every", every, 1),
        ):
            if value < least:
                raise BadInput(f"decoder.motion.{name}={value}: must be at least {least}")
        if block < 4 or block % 4:
            raise BadInput(f"decoder.motion.block={block}: must be a multiple of 4")
        if not deviation > 0:
            raise BadInput(f"decoder.motion.deviation={deviation}: must be positive")
        self.frames, self.reach, self.block, self.deviation = frames, reach, block, deviation
        self.after, self.every = after, every
        self.reset()

    def reset(self) -> None:
        """Other videos follow: no motion is known of them."""
        self._paths: list[Path] = []
        self._calls = 0

    def forward(self, video: torch.Tensor) -> torch.Tensor:
        """Filter ``(N, T, H, W)``, or give it back while no motion is known."""
        if self._calls >= self.after and (self._calls - self.after) % self.every == 0:
            self._paths = self._search(video)
        self._calls += 1
        if not self._paths:
            return video
        total, weights = video.clone(), torch.ones_like(video)
        for here, there, pixel, weight in self._paths:
            found = video[:, there].flatten(2).gather(2, pixel).view_as(weight)
            total[:, here].addcmul_(found, weight)
            weights[:, here].add_(weight)
        return total.div_(weights)

    @torch.no_grad()
    def _search(self, video: torch.Tensor) -> list[Path]:
        t, height, width = video.shape[1:]
        whole = F.pad(video, (0, -width % self.block, 0, -height % self.block), mode="replicate")
        smooth = F.avg_pool2d(whole, SMOOTH, 1, SMOOTH // 2, count_include_pad=False)
        around = F.pad(smooth, (self.reach,) * 4, mode="replicate")
        near = min(self.frames, t - 1)
        offsets = [offset for offset in range(-near, near + 1) if offset]
        slices = [(slice(max(0, -each), t - max(0, each)), slice(max(0, each), t + min(0, each))) for each in offsets]
        paths = []
        for here, there in slices:
            pixel, weight = self._follow(smooth[:, here], around[:, there], height, width)
            paths.append(Path(here, there, pixel, weight))
        return paths

    def _follow(
        self, frames: torch.Tensor, others: torch.Tensor, height: int, width: int
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Pixel and weight of a :class:`Path` from ``frames``, of whole blocks, to ``others``, wider by ``reach``."""
        side, cell = 2 * self.reach + 1, self.block // SAMPLED
        sampled = frames[..., ::SAMPLED, ::SAMPLED].contiguous()
        rows, columns = sampled.shape[-2:]
        apart = [[others[..., y::SAMPLED, x::SAMPLED].contiguous() for x in range(SAMPLED)] for y in range(SAMPLED)]
        unlike = []
        for move in range(side**2):
            (dy, y), (dx, x) = (divmod(each, SAMPLED) for each in divmod(move, side))
            square = (apart[y][x][..., dy : dy + rows, dx : dx + columns] - sampled).square_()
            unlike.append(F.avg_pool2d(square, cell, padding=cell // 2, count_include_pad=False))
        overlapping = F.avg_pool2d(torch.stack(unlike).flatten(0, 1), 2, stride=1).unflatten(0, (side**2, -1))
        least, best = (
            each.repeat_interleave(self.block, -2).repeat_interleave(self.block, -1)[..., :height, :width]
            for each in overlapping.min(0)
        )
        here, across = (torch.arange(length, device=frames.device) for length in (height, width))
        row = (here[:, None] + best // side - self.reach).clamp_(0, height - 1)
        column = (across + best % side - self.reach).clamp_(0, width - 1)
        return (row * width + column).flatten(2), torch.exp(least / (-2 * self.deviation**2))
