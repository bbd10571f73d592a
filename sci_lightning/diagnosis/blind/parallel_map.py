"""One function on every core: torch itself decomposes many small matrices on a single one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

Part = TypeVar("Part")
Result = TypeVar("Result")


def on_every_core(
    function: Callable[[Part], Result], parts: Iterable[Part], at_a_time: int | None = None
) -> list[Result]:
    """Return what a function makes of every part, in order; nothing is differentiated.

    As many parts are computed at a time as torch has threads, each by one thread. Inside a part, torch and other calls
    of this function use one thread. An error or Ctrl-C ends the parts that have not begun.

    Args:
        function: of a part; it must not write where another call reads.
        parts: of the work.
        at_a_time: parts that are computed at a time at most, because of their memory; None: no limit. One part at a
            time may use all threads.
    """
    threads, inference = torch.get_num_threads(), torch.is_inference_mode_enabled()

    def compute(part: Part) -> Result:
        with torch.inference_mode(inference), torch.no_grad():
            return function(part)

    workers = min(threads, threads if at_a_time is None else at_a_time)
    if workers <= 1:
        return [compute(part) for part in parts]
    try:
        with ThreadPoolExecutor(workers, initializer=lambda: torch.set_num_threads(1)) as pool:
            try:
                return list(pool.map(compute, parts))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    finally:
        torch.set_num_threads(threads)  # the workers' setting is that of threads that start later, too
