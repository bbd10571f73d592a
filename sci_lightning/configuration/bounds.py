"""The ranges of arguments that many classes share, as types.

An annotation such as ``channels: Width`` says type and range in one place: whatever builds an object from a
configuration reads it there, see :mod:`sci_lightning.configuration.arguments`. A notebook that calls the class itself
passes ordinary numbers. The upper bounds lie far beyond what anybody computes with; they exist so that a typing error
(``frames=100000``) ends with a sentence instead of an exhausted machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from annotated_types import DocInfo, Interval, Len

MOST_FRAMES = 4096

Frames: TypeAlias = Annotated[int, Interval(ge=2, le=MOST_FRAMES)]
"""T, the number of time slots of a snapshot."""

Pixels: TypeAlias = Annotated[int, Interval(ge=1, le=65536)]
"""A length on the sensor or in the image, in pixels."""

Size: TypeAlias = Annotated[Sequence[Pixels], Len(2, 2)]
"""(H, W) in pixels."""

Step: TypeAlias = Annotated[Sequence[Annotated[float, Interval(ge=-65536, le=65536)]], Len(2, 2)]
"""(rows, columns) in pixels by which something moves from one slot to the next, +down and +right."""

Bits: TypeAlias = Annotated[int, Interval(ge=1, le=8)]
"""Bit depth of a mask."""

Width: TypeAlias = Annotated[int, Interval(ge=1, le=65536)]
"""Channels of a layer."""

Depth: TypeAlias = Annotated[int, Interval(ge=1, le=1024)]
"""How often something is repeated in a network: blocks, stages, heads, groups."""

Repeats: TypeAlias = Annotated[int, Interval(ge=1, le=10**9)]
"""How often something is done, at least once: clips of an epoch, calls."""

MOST_ITERATIONS = 10_000
"""A hundred times as many as published iterative decoders make. More would keep a machine busy for days, and a
checkpoint or an encoder file of a stranger says how many there are."""

Iterations: TypeAlias = Annotated[int, Interval(ge=1, le=MOST_ITERATIONS)]
"""Iterations of a decoder, for one measurement."""

Steps: TypeAlias = Annotated[int, Interval(ge=1, le=1000)]
"""Steps within an iteration."""

Reach: TypeAlias = Annotated[int, Interval(ge=0, le=64)]
"""How far something is looked for, in pixels or frames: time grows with its square."""

Scenes: TypeAlias = Annotated[int, Interval(ge=1, le=100_000)]
"""Scenes and snapshots that are made up for a test."""

Seed: TypeAlias = Annotated[int, Interval(ge=0, lt=2**63)]
"""The start of a random generator."""

Positive: TypeAlias = Annotated[float, Interval(gt=0, lt=float("inf"))]
"""A positive number."""

NonNegative: TypeAlias = Annotated[float, Interval(ge=0, lt=float("inf"))]
"""A number that is 0 or more."""

Share: TypeAlias = Annotated[float, Interval(ge=0, le=1)]
"""A part of a whole."""


@dataclass(frozen=True)
class Exists:
    """Marks a path that must be there before anything is loaded; a pattern with ``*`` is looked at where it is used.

    Attributes:
        or_name: whether a word without a suffix and a slash may be a name that stands for something else.
    """

    or_name: bool = False


ExistingPath: TypeAlias = Annotated[
    Annotated[str, Len(1)] | Path, Exists(), DocInfo("the path of a file or a folder that exists")
]
"""A file or folder to read."""

BayerPattern: TypeAlias = Literal["rggb", "grbg", "gbrg", "bggr"]
"""Colours of a cell of 2 x 2 pixels of a Bayer sensor, row by row."""
CHANNELS = ("red", "green", "blue")
"""Of a video in colour."""
