"""What a hypothesis about the camera predicts."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

import torch

from sci_lightning.diagnosis.model.likelihood import ClippedSignal


@dataclass(frozen=True)
class Prediction:
    """What a hypothesis predicts for every pixel before the converter.

    Attributes:
        mean: ``(N, H, W)`` expected signal, DN.
        deviation: ``(N, H, W)`` its standard deviation, DN.
        bits: effective bits of the converter.
        clipped: the distribution where the signal saturates before the converter does; None if it does not.
        window: rows and columns of the field that it is of; None where nobody asks.
    """

    mean: torch.Tensor
    deviation: torch.Tensor
    bits: int
    clipped: ClippedSignal | None = None
    window: tuple[slice, slice] | None = None

    @property
    def total_variance(self) -> torch.Tensor:
        """``(N, H, W)`` variance of a pixel's DN, DN squared, quantisation counted as noise."""
        return self.deviation.square() + 1 / 12


T = TypeVar("T")


class Recent(Generic[T]):
    """The last few results of a slow computation, by key; several threads may ask at a time.

    Args:
        size: how many results to remember.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._results: OrderedDict[Hashable, T] = OrderedDict()

    def get(self, key: Hashable, compute: Callable[[], T]) -> T:
        """Return the result for a key, which is not None; it is computed if it is not remembered."""
        result = self._results.get(key)
        if result is None:
            result = self._results[key] = compute()
        with suppress(KeyError):  # another thread may have needed the room already
            self._results.move_to_end(key)
            if len(self._results) > self._size:
                self._results.popitem(last=False)
        return result
