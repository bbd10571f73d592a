"""Shifting mask: one pattern that moves from slot to slot, as in cameras with a mask on a translation stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import torch

from sci_lightning.configuration.bounds import Frames, Seed, Size, Step
from sci_lightning.encoder.mask.mask import Mask
from sci_lightning.encoder.mask.structure import uniform
from sci_lightning.errors import BadInput
from sci_lightning.files.mask_file import read_mask_file


class Shifting(Mask):
    r"""One pattern P that moves by whole or part pixels: :math:`M_t(p) = P(p - s - t\,d)`, with d the step.

    The pattern is as much larger than the field as it moves, so that its edge never enters; s places it so.

    Args:
        frames, size, tile: see :class:`~sci_lightning.encoder.mask.Mask`; a tile that repeats moves as a whole.
        step: d, (rows, columns) in pixels from one slot to the next, +down and +right. Part pixels are the exact
            overlap of square cells with square pixels, so that the mask has gray levels.
        seed: of the pattern, which is open with probability 1/2.
        file: of a measured pattern ``(h, w)`` in [0, 1] to take instead, see
            :func:`~sci_lightning.files.mask_file.read_mask_file`; what lies beyond it is dark.
        key: name of its array.

    Raises:
        BadInput: a step of (0, 0), a file together with a tile, or one that holds no single pattern.

    Source: Llull et al., "Coded aperture compressive temporal imaging", Optics Express 2013.
    """

    def __init__(
        self,
        frames: Frames,
        size: Size,
        step: Step = (1, 0),
        tile: Size | None = None,
        seed: Seed = 0,
        file: str | Path | None = None,
        key: str | None = None,
    ) -> None:
        super().__init__(frames, size, tile)
        if not any(step):
            raise BadInput(f"encoder.mask.step={list(step)}: all slots would be equal; give a step other than [0,0]")
        travel = [math.ceil(abs(one) * (frames - 1)) for one in step]
        if file is not None:
            if tile is not None:
                raise BadInput(f"encoder.mask.tile={list(tile)}: {file} is the whole pattern; leave tile= out")
            measured = read_mask_file(file, key, one_pattern=True, setting="encoder.mask.key")
            if measured.ndim != 2:
                raise BadInput(f"{file}: {len(measured)} patterns, expected one, (H, W); see encoder/mask=measured")
            pattern = torch.from_numpy(measured.astype("float32"))
        else:
            shape = self.tile if tile is not None else [side + far for side, far in zip(self.size, travel, strict=True)]
            pattern = (uniform(shape, seed) < 0.5).float()
        repeats = self.tile != self.size
        self.register_buffer("pattern", moved_pattern(pattern, frames, self.tile, step, wrap=repeats))

    @property
    def automatic_aperture(self) -> float:
        """1 over the mean of the mask's sum over time."""
        total = float(self.pattern.sum(0).mean())
        return 1 / total if total > 0 else 1.0


def moved_pattern(
    pattern: torch.Tensor,
    frames: int,
    size: Sequence[int],
    step: Sequence[float],
    origin: Sequence[float] | None = None,
    wrap: bool = False,
) -> torch.Tensor:
    """Return the masks ``(T, H, W)`` of one pattern ``(h, w)`` that moves by ``step`` from slot to slot.

    Args:
        pattern: in [0, 1].
        frames: T.
        size: (H, W) of the field.
        step: (rows, columns) in pixels, +down and +right.
        origin: (row, column) of the pattern at which the field begins in the first slot. None: along every axis the
            pattern begins at that edge of the field from which it moves, or, where it is larger than the field, so that
            it ends there.
        wrap: whether the pattern repeats; else it is dark beyond it.
    """
    if origin is None:
        room = [side - own for side, own in zip(size, pattern.shape, strict=True)]
        edges = [min(0, free) if one >= 0 else max(0, free) for free, one in zip(room, step, strict=True)]
        origin = [0 if wrap or not one else -edge for edge, one in zip(edges, step, strict=True)]
    slots = []
    for slot in range(frames):
        shown = pattern
        for axis in (0, 1):
            place = origin[axis] - slot * step[axis]
            first = math.floor(place)
            part = round(place - first, 9)
            taken = _taken(shown, axis, first, size[axis], wrap)
            shown = (1 - part) * taken + part * _taken(shown, axis, first + 1, size[axis], wrap) if part else taken
        slots.append(shown)
    return torch.stack(slots)


def _taken(image: torch.Tensor, axis: int, first: int, count: int, wrap: bool) -> torch.Tensor:
    """Return ``count`` rows or columns from ``first`` on, which wrap around or are 0 beyond the image."""
    places = torch.arange(first, first + count)
    length = image.shape[axis]
    if wrap:
        return image.index_select(axis, places % length)
    inside = ((places >= 0) & (places < length)).to(image.dtype)
    return image.index_select(axis, places.clamp(0, length - 1)) * (inside[:, None] if axis == 0 else inside)
