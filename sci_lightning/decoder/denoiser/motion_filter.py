"""Motion-compensated temporal filtering: every frame is averaged with its neighbours along the motion."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import torch
from annotated_types import Interval
from torch import nn
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Pixels, Reach, Repeats
from sci_lightning.errors import BadInput

SMOOTH = 3
"""Side of the box filter, in pixels, that reduces noise before blocks are compared."""

SAMPLED = 2
"""Blocks are then compared at one in so many rows and columns."""


class Path(NamedTuple):
    """The motion from frames to their neighbours at one distance in time."""

    here: slice
    """Frames from which the path leads."""
    there: slice
    """Neighbours to which it leads."""
    pixel: torch.Tensor
    """Number of the matching pixel in the neighbour, ``(N, frames, H * W)``."""
    weight: torch.Tensor
    """Weight of the matching pixel, ``(N, frames, H, W)``: 1 for equal blocks, towards 0 for different ones."""


class MotionFilter(nn.Module):
    """A weighted mean of every pixel and of the pixels that match it in neighbouring frames.

    For every block of a frame, a search in each of the ``frames`` frames before and after it finds the displacement
    with the smallest mean square difference d^2. The matching pixels get the weight exp(-d^2 / 2 deviation^2), so that
    a block without a match stays as it is. For the comparison, blocks overlap by half on every side. Videos of one
    batch do not mix. Gradients flow through the mean, not through the search.

    Args:
        frames: number of neighbours before and after.
        reach: largest displacement in rows and columns, in pixels.
        block: side of the blocks that move together, in pixels; a multiple of 4.
        deviation: scale of the differences between matching blocks, in units of the video.
        after: number of calls before the first search, while the video is too rough for one.
        every: number of calls for which a search is used; :meth:`reset` ends that early.

    Raises:
        BadInput: a number is out of these ranges.

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
        """Forget the motion, because other videos follow."""
        self._paths: list[Path] = []
        self._calls = 0

    def forward(self, video: torch.Tensor) -> torch.Tensor:
        """Return the filtered video ``(N, T, H, W)``, or the video itself while no motion is known."""
        if self._calls >= self.after and (self._calls - self.after) % self.every == 0:
            self._paths = self._search(video)
        self._calls += 1
        if not self._paths:
            return video
        total, weights = video.clone(), torch.ones_like(video)
        for here, there, pixel, weight in self._paths:
            matches = video[:, there].flatten(2).gather(2, pixel).view_as(weight)
            total[:, here].addcmul_(matches, weight)
            weights[:, here].add_(weight)
        return total.div_(weights)

    @torch.no_grad()
    def _search(self, video: torch.Tensor) -> list[Path]:
        """Return the paths from all frames to their neighbours, one for every distance in time."""
        t, height, width = video.shape[1:]
        whole = F.pad(video, (0, -width % self.block, 0, -height % self.block), mode="replicate")
        smooth = F.avg_pool2d(whole, SMOOTH, 1, SMOOTH // 2, count_include_pad=False)
        around = F.pad(smooth, (self.reach,) * 4, mode="replicate")
        near = min(self.frames, t - 1)
        offsets = [offset for offset in range(-near, near + 1) if offset]
        slices = [
            (slice(max(0, -offset), t - max(0, offset)), slice(max(0, offset), t + min(0, offset)))
            for offset in offsets
        ]
        paths = []
        for here, there in slices:
            pixel, weight = self._follow(smooth[:, here], around[:, there], height, width)
            paths.append(Path(here, there, pixel, weight))
        return paths

    def _follow(
        self, frames: torch.Tensor, others: torch.Tensor, height: int, width: int
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return pixel and weight of a :class:`Path` from ``frames``, padded to whole blocks, to ``others``.

        ``others`` has a margin of ``reach`` pixels on every side.
        """
        side, cell = 2 * self.reach + 1, self.block // SAMPLED
        sampled = frames[..., ::SAMPLED, ::SAMPLED].contiguous()
        rows, columns = sampled.shape[-2:]
        phases = [[others[..., y::SAMPLED, x::SAMPLED].contiguous() for x in range(SAMPLED)] for y in range(SAMPLED)]
        differences = []
        for move in range(side**2):
            (dy, y), (dx, x) = (divmod(offset, SAMPLED) for offset in divmod(move, side))
            square = (phases[y][x][..., dy : dy + rows, dx : dx + columns] - sampled).square_()
            differences.append(F.avg_pool2d(square, cell, padding=cell // 2, count_include_pad=False))
        overlapping = F.avg_pool2d(torch.stack(differences).flatten(0, 1), 2, stride=1).unflatten(0, (side**2, -1))
        least, best = (
            result.repeat_interleave(self.block, -2).repeat_interleave(self.block, -1)[..., :height, :width]
            for result in overlapping.min(0)
        )
        here, across = (torch.arange(length, device=frames.device) for length in (height, width))
        row = (here[:, None] + best // side - self.reach).clamp_(0, height - 1)
        column = (across + best % side - self.reach).clamp_(0, width - 1)
        return (row * width + column).flatten(2), torch.exp(least / (-2 * self.deviation**2))
