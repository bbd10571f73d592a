"""A field that is cut into tiles, which are computed one after another with a halo of their neighbours' pixels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise, product
from typing import NamedTuple

import torch

from sci_lightning.errors import BadInput

Size = tuple[int, int]

SEAM_TOLERANCE = 1 / 255
"""Largest difference of two neighbouring tiles at the seam between them, as a root mean square in units of the video.

Behind the seam the difference falls off, and few pixels lie at one: a decoder of 35 dB loses less than 0.01 dB by it.
"""


class SeamsDiffer(Exception):
    """Two neighbouring tiles differ too much at their seam; ``difference`` is the root mean square."""

    def __init__(self, difference: float) -> None:
        super().__init__(f"tiles differ by {difference:.2g} at their seam")
        self.difference = difference


MOST = 256
"""Largest number of tiles from top to bottom, and from left to right, that is considered."""


@dataclass(frozen=True)
class Span:
    """Where one tile lies along one axis of the field, in pixels.

    Args:
        start, stop: first pixel that the tile contributes to the field, and the one after its last.
        read_start, read_stop: the same with the halo.
    """

    start: int
    stop: int
    read_start: int
    read_stop: int

    def __len__(self) -> int:
        """Return the number of pixels that are computed."""
        return self.read_stop - self.read_start

    @property
    def kept(self) -> slice:
        """The pixels that the tile contributes to the field."""
        return slice(self.start, self.stop)

    @property
    def read(self) -> slice:
        """The pixels that are computed: the kept ones and the halo."""
        return slice(self.read_start, self.read_stop)

    @property
    def inside(self) -> slice:
        """The kept pixels, counted from the beginning of the halo."""
        return slice(self.start - self.read_start, self.stop - self.read_start)


class Tile(NamedTuple):
    """One part of the field."""

    rows: Span
    columns: Span

    @property
    def pixels(self) -> int:
        """Number of pixels that are computed for the tile, with its halo."""
        return len(self.rows) * len(self.columns)

    def scaled(self, scale: Fraction) -> Tile:
        """Return the tile on a field whose sides are ``scale`` times as long."""
        rows, columns = (
            Span(*(int(edge * scale) for edge in (span.start, span.stop, span.read_start, span.read_stop)))
            for span in (self.rows, self.columns)
        )
        return Tile(rows, columns)

    def of(self, image: torch.Tensor) -> torch.Tensor:
        """Return what has to be read of an image or video ``(.., H, W)``, with the halo: a view."""
        return image[..., self.rows.read, self.columns.read]


@dataclass(frozen=True)
class Tiling:
    """How a field is cut: in tiles of a given size, or in as few as keep to a number of pixels.

    Args:
        size: height and width of a tile in pixels without its halo; None to let ``pixels`` decide.
        pixels: largest number of pixels of a tile with its halo; only used without ``size``.
        watch: called after every tile with its number, from 1, and the number of tiles.

    Raises:
        BadInput: neither is given, or a number is not positive.

    Example:
        >>> import torch
        >>> from torch.nn import functional as F
        >>> frames = torch.rand(1, 1, 20, 30)
        >>> blurred = Tiling(size=(8, 8)).apply(lambda x: F.avg_pool2d(x, 3, 1, 1), 1, 1, frames)
        >>> torch.equal(blurred, F.avg_pool2d(frames, 3, 1, 1))
        True
    """

    size: Size | None = None
    pixels: int | None = None
    watch: Callable[[int, int], object] | None = None

    def __post_init__(self) -> None:
        if min(self.size or (self.pixels or 0,)) < 1:
            given = self.pixels if self.size is None else f"[{self.size[0]},{self.size[1]}]"
            raise BadInput(f"tile={given}: height and width must be positive numbers of pixels")

    def silent(self) -> Tiling:
        """Return the same tiling without ``watch``, for a caller that reports its progress itself."""
        return replace(self, watch=None)

    def tiles(self, field: Size, halo: int, alignment: int = 1) -> list[Tile]:
        """Return the tiles that cover a field, row by row.

        Args:
            field: height and width in pixels.
            halo: pixels that are read around a tile, as far as the field goes.
            alignment: tiles begin, with and without their halo, at multiples of so many pixels.

        Raises:
            BadInput: a tile is smaller than the halo, and not as large as the field either.
        """
        if self.size is not None:
            (height, width), (rows, columns) = self.size, field
            if height < min(halo, rows) or width < min(halo, columns):
                raise BadInput(
                    f"tile=[{height},{width}] is smaller than the halo of {halo} pixels that this decoder needs around "
                    f"a tile; give at least 'tile=[{halo},{halo}]', or tile=auto"
                )
            spans = (_spans(s, -(-s // part), halo, alignment) for s, part in zip(field, self.size, strict=True))
            return [Tile(row, column) for row, column in product(*spans)]
        return self._few(field, halo, alignment)

    def _few(self, field: Size, halo: int, alignment: int) -> list[Tile]:
        """Return the tiles of at most ``pixels`` with which the least is computed; the smallest, if all are larger."""
        least = max(halo, alignment)
        sides = [
            [_spans(side, number, halo, alignment) for number in range(1, min(side // least, MOST) + 1)]
            or [[Span(0, side, 0, side)]]
            for side in field
        ]
        best, work = (sides[0][-1], sides[1][-1]), math.inf
        for rows in sides[0]:
            for columns in sides[1]:  # the fewer, the less is computed twice
                if max(map(len, rows)) * max(map(len, columns)) <= (self.pixels or 0):
                    if (total := sum(map(len, rows)) * sum(map(len, columns))) < work:
                        best, work = (rows, columns), total
                    break
        return [Tile(row, column) for row, column in product(*best)]

    def apply(
        self,
        function: Callable[..., torch.Tensor],
        halo: int,
        alignment: int,
        *images: torch.Tensor,
        seam_tolerance: float | None = None,
        reduced: int = 1,
    ) -> torch.Tensor:
        """Return ``function(*images)``, computed tile by tile.

        Args:
            function: takes parts of the images, and returns an image or video of as many rows and columns, or of a
                multiple or part of both.
            halo, alignment: see :meth:`tiles`.
            images: images or videos ``(.., H, W)`` of the same H and W.
            seam_tolerance: how much neighbouring tiles may differ at their seam, as a root mean square, where the halo
                may be too small; None: they are not compared.
            reduced: resolution of the field over that of the images; all other numbers are in pixels of the field.

        Raises:
            BadInput: as :meth:`tiles`.
            SeamsDiffer: two tiles differ by more than ``seam_tolerance``.
        """
        field = images[0].shape[-2], images[0].shape[-1]
        tiles = self.tiles((reduced * field[0], reduced * field[1]), halo, alignment)
        if len(tiles) == 1:
            result = function(*images)
        for number, tile in enumerate(tiles if len(tiles) > 1 else (), 1):
            read = tile.scaled(Fraction(1, reduced))
            part = function(*(read.of(image) for image in images))
            scale = Fraction(part.shape[-1], len(read.columns))
            if number == 1:
                result = part.new_empty(*part.shape[:-2], *(int(side * scale) for side in field))
            tile = read.scaled(scale)
            if (
                seam_tolerance is not None
                and not part.is_meta
                and (difference := _seam_difference(result, part, tile)) > seam_tolerance
            ):
                raise SeamsDiffer(difference)
            result[..., tile.rows.kept, tile.columns.kept] = part[..., tile.rows.inside, tile.columns.inside]
            del part  # before the next one is made
            if self.watch is not None:
                self.watch(number, len(tiles))
        return result


def _spans(side: int, number: int, halo: int, alignment: int) -> list[Span]:
    """Return the spans of ``number`` tiles along a side, fewer where the alignment leaves no room for so many."""
    inner = {round(side * cut / number / alignment) * alignment for cut in range(1, number)}
    cuts = [0, *sorted(cut for cut in inner if 0 < cut < side), side]
    reach = -(-halo // alignment) * alignment
    return [Span(start, stop, max(0, start - reach), min(side, stop + reach)) for start, stop in pairwise(cuts)]


def _seam_difference(result: torch.Tensor, part: torch.Tensor, tile: Tile) -> float:
    """Return how far a tile is from its neighbours above and to the left, in their last row and column; 0 without any.

    Both were computed with the same halo, at whose half the seam is: there the two differ most of what is kept.
    """
    squares = []
    for span, other, axis in ((tile.rows, tile.columns, -2), (tile.columns, tile.rows, -1)):
        if span.start > span.read_start:  # without a halo nothing was computed twice
            before = result.select(axis, span.start - 1).narrow(-1, other.start, other.stop - other.start)
            here = part.select(axis, span.start - 1 - span.read_start)[..., other.inside]
            squares.append((before - here).float().square().mean())
    return float(torch.stack(squares).max().sqrt()) if squares and not part.is_meta else 0.0
