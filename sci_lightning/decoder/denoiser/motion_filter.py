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

MOTION_PIXELS = 2**17
"""Pixels of the frames whose motion is searched for together; more of them need more memory and are no faster."""


class Match(NamedTuple):
    """The blocks of another frame that match those of one frame."""

    frame: int
    """Number of the other frame."""
    displacement: torch.Tensor
    """Displacement of every block, ``(N, rows of blocks, columns of blocks)``: its number in a square of side
    2 reach + 1, row by row."""
    weight: torch.Tensor
    """Weight of the matching block, of the same shape: 1 for equal blocks, towards 0 for different ones."""


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
        self._matches: list[list[Match]] = []
        self._calls = 0

    def forward(self, video: torch.Tensor) -> torch.Tensor:
        """Return the filtered video ``(N, T, H, W)``, or the video itself while no motion is known.

        Apart from its result it needs memory for a few frames, however many there are.
        """
        if self._calls >= self.after and (self._calls - self.after) % self.every == 0:
            self._matches = self._search(video)
        self._calls += 1
        if not self._matches:
            return video
        n, t, height, width = video.shape
        side, block = 2 * self.reach + 1, self.block
        rows, columns = (-(-length // block) for length in (height, width))  # of blocks
        margin = (self.reach, self.reach + columns * block - width, self.reach, self.reach + rows * block - height)
        across = columns * block + 2 * self.reach
        position = torch.arange(rows * block, device=video.device)[:, None] * across
        position = (position + torch.arange(columns * block, device=video.device)).view(rows, block, -1)

        def on_pixels(of_blocks: torch.Tensor) -> torch.Tensor:  # (N, rows of blocks, 1, W): whole rows are fastest
            return of_blocks.repeat_interleave(block, -1).unsqueeze(2)

        memory = None  # for the numbers of the matching pixels; gradients keep them all
        if not torch.is_grad_enabled():
            memory = torch.empty(n, *position.shape, dtype=position.dtype, device=video.device)
        filtered = torch.empty_like(video, memory_format=torch.contiguous_format)
        around: dict[int, torch.Tensor] = {}  # frames with a margin, in which no displacement leads out
        for number, matches in enumerate(self._matches):
            near = range(max(0, number - self.frames), min(t, number + self.frames + 1))
            around = {
                other: around[other]
                if other in around
                else F.pad(video[:, other : other + 1], margin, mode="replicate")
                for other in near
            }
            frame = around[number][:, 0, self.reach :, self.reach :][:, : rows * block, : columns * block]
            total = frame.reshape(n, rows, block, columns * block).clone()
            weights = torch.ones_like(matches[0].weight) if matches else video.new_ones(n, rows, columns)
            for match in matches:
                down, right = match.displacement // side, match.displacement % side
                pixel = torch.add(position, on_pixels(down * across + right), out=memory)
                matching = around[match.frame].flatten(1).gather(1, pixel.flatten(1)).view_as(total)
                total.addcmul_(matching, on_pixels(match.weight))
                weights = weights + match.weight
            total = total.div_(on_pixels(weights)).view(n, rows * block, columns * block)
            filtered[:, number] = total[:, :height, :width]
        return filtered

    @torch.no_grad()
    def _search(self, video: torch.Tensor) -> list[list[Match]]:
        """Return for every frame the matches of its blocks in its neighbours."""
        n, t, height, width = video.shape
        margin = (0, -width % self.block, 0, -height % self.block)
        smooth: dict[int, torch.Tensor] = {}
        matches: list[list[Match]] = [[] for _ in range(t)]
        together = max(1, MOTION_PIXELS // (n * height * width))
        for first in range(0, t, together):
            last = min(t, first + together)
            for number in range(max(0, first - self.frames), min(t, last + self.frames)):
                if number not in smooth:
                    whole = F.pad(video[:, number : number + 1], margin, mode="replicate")
                    smooth[number] = F.avg_pool2d(whole, SMOOTH, 1, SMOOTH // 2, count_include_pad=False)
            for offset in range(-self.frames, self.frames + 1):
                here = [number for number in range(first, last) if offset and 0 <= number + offset < t]
                if here:
                    frames, others = (torch.cat([smooth[k + shift] for k in here], 1) for shift in (0, offset))
                    followed = self._follow(frames, F.pad(others, (self.reach,) * 4, mode="replicate"))
                    for number, displacement, weight in zip(here, *(part.unbind(1) for part in followed), strict=True):
                        matches[number].append(Match(number + offset, displacement, weight))
            smooth = {number: frame for number, frame in smooth.items() if number >= last - self.frames}
        return matches

    def _follow(self, frames: torch.Tensor, others: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return displacement and weight of a :class:`Match`, ``(N, frames, rows, columns)`` of blocks.

        ``frames`` is padded to whole blocks, ``others`` has a margin of ``reach`` pixels on every side as well.
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
        least, best = overlapping.min(0)
        return best, torch.exp(least / (-2 * self.deviation**2))
