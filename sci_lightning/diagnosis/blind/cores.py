"""One function on every core: torch itself decomposes many small matrices on a single one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

Part = TypeVar("Part")
Result = TypeVar("Result")


def on_every_core(function: Callable[[Part], Result], parts: Iterable[Part]) -> list[Result]:
    """Return what a function makes of every part, in order; nothing is differentiated.

    As many parts are computed at a time as torch has threads, each by one thread. Inside a part, torch and other calls
    of this function use one thread.

    Args:
        function: of a part; it must not write where another call reads.
        parts: of the work.
    """
    threads = torch.get_num_threads()
    function = torch.no_grad()(function)
    if threads == 1:
        return [function(part) for part in parts]
    with ThreadPoolExecutor(threads, initializer=lambda: torch.set_num_threads(1)) as pool:
        try:
            return list(pool.map(function, parts))
        finally:
            torch.set_num_threads(threads)  # the workers' setting is that of threads that start later, too
