"""Random training clips, cut from longer and larger ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.errors import BadInput


class Augmentation:
    """Random cuts of T frames and ``crop`` pixels from a clip, resized, turned and sped up at random.

    Args:
        frames: T.
        crop: ``(h, w)`` in pixels of the result.
        max_stride: every 1st, 2nd, ... or ``max_stride``-th frame is taken, as far as the clip is long enough; 1 keeps
            the speed.
        reverse: whether half of the clips, at random, are played backwards.
        scale: the result is resized, with antialiasing, from a region s times as large, s uniform between these two
            numbers, as far as the clip is large enough; ``(1, 1)`` keeps the size.
        flip: whether clips are mirrored left-right and top-bottom, each with probability 1/2.
        rotate: whether clips are turned by 0, 90, 180 or 270 degrees; only if ``crop`` is square.

    Raises:
        BadInput: an argument is out of range.
    """

    def __init__(
        self,
        frames: int,
        crop: Sequence[int],
        *,
        max_stride: int = 2,
        reverse: bool = True,
        scale: Sequence[float] = (0.75, 2.0),
        flip: bool = True,
        rotate: bool = True,
    ) -> None:
        self.frames = frames
        self.height, self.width = crop
        self.max_stride = max_stride
        self.reverse = reverse
        self.smallest, self.largest = scale
        self.flip = flip
        self.rotate = rotate and self.height == self.width
        if frames < 1 or min(crop) < 1:
            raise BadInput(f"frames={frames}, crop={tuple(crop)}: all must be at least 1")
        if max_stride < 1:
            raise BadInput(f"max_stride={max_stride}: must be at least 1, which keeps the speed")
        if not 0 < self.smallest <= self.largest:
            raise BadInput(f"scale={tuple(scale)}: must be two rising positive numbers, as in (0.75, 2.0)")

    def region(self, scale: float) -> tuple[int, int]:
        """Return height and width, in pixels of the clip, of the region that becomes the crop at ``scale``."""
        return max(1, round(self.height * scale)), max(1, round(self.width * scale))

    def check(self, shape: tuple[int, int, int], name: object) -> None:
        """Raise BadInput with the name of the clip if its shape (F, H, W) is too short or too small."""
        length, height, width = shape
        rows, columns = self.region(self.smallest)
        if length < self.frames:
            raise BadInput(f"{name}: has {length} frames; a training clip needs {self.frames}")
        if height < rows or width < columns:
            raise BadInput(
                f"{name}: has {height} x {width} pixels; a training clip needs {rows} x {columns}; "
                "give a smaller 'size=[H,W]', or experiment=quickstart, which trains on small clips"
            )

    def __call__(self, clip: np.ndarray, random: np.random.Generator) -> torch.Tensor:
        """Return float32 ``(T, h, w)`` in [0, 1] from uint8 ``(F, H, W)``, of which only the needed part is read."""
        length, height, width = clip.shape
        longest = (length - 1) // max(1, self.frames - 1)
        stride = int(random.integers(1, max(1, min(self.max_stride, longest)), endpoint=True))
        span = (self.frames - 1) * stride + 1
        start = int(random.integers(length - span, endpoint=True))

        largest = min(self.largest, height / self.height, width / self.width)
        rows, columns = self.region(random.uniform(self.smallest, max(self.smallest, largest)))
        top = int(random.integers(height - rows, endpoint=True))
        left = int(random.integers(width - columns, endpoint=True))

        drawn = clip[start : start + span : stride, top : top + rows, left : left + columns]
        backwards, mirrored, upside_down = random.random(3) < 0.5
        if self.reverse and backwards:
            drawn = drawn[::-1]
        if self.flip and mirrored:
            drawn = drawn[:, :, ::-1]
        if self.flip and upside_down:
            drawn = drawn[:, ::-1]
        if self.rotate:
            drawn = np.rot90(drawn, int(random.integers(4)), axes=(1, 2))
        return self._resize(torch.from_numpy(np.array(drawn)).float().div_(255))

    def _resize(self, video: torch.Tensor) -> torch.Tensor:
        size = (self.height, self.width)
        if video.shape[1:] == size:
            return video
        video = F.interpolate(video[None], size, mode="bilinear", antialias=True)[0]
        return video.clamp_(0, 1)  # the weights sum to one only up to rounding
