"""Random numbers of one purpose."""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, purpose: str) -> np.random.Generator:
    """The numbers that ``seed`` keeps for one purpose, independent of every other purpose's.

    So hiding an effect changes neither the patterns nor the scenes, and two cameras compared at one seed share them.
    """
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])
