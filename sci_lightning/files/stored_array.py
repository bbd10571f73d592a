"""An array that lies in a file and has not been read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class StoredArray:
    """What a file says of an array, and how to read it.

    Attributes:
        shape: as declared, in the order of axes that ``read`` returns.
        dtype: name of the type as declared, such as ``uint8``, ``complex128`` or ``struct``.
        numeric: whether it is an array of real numbers or booleans.
        read: reads it, after it was checked against the bounds of memory_bound.py; raises BadInput without the name
            of the file, or whatever the reader makes of damage.
    """

    shape: tuple[int, ...]
    dtype: str
    numeric: bool
    read: Callable[[], np.ndarray]


def readable_shape(shape: Iterable[object]) -> str:
    """Return a shape as messages write it: ``8 x 256 x 256``."""
    return " x ".join(str(side) for side in shape)
