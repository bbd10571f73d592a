"""The last few results of a slow computation."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Generic, TypeVar

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
        with suppress(KeyError):  # another thread may have removed it already
            self._results.move_to_end(key)
            if len(self._results) > self._size:
                self._results.popitem(last=False)
        return result
