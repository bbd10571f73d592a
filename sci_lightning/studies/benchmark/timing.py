"""Times of calls that take turns, so that what else a machine does meets all of them alike."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import torch

Call = Callable[[], Any]


def seconds_in_turns(
    calls: Mapping[str, Call], place: torch.device, warm_up: int, repeats: int, budget: float = math.inf
) -> dict[str, list[float]]:
    """Return the seconds of every timed call, by name: one call of each, then the next one of each.

    Args:
        calls: what is timed.
        place: device whose work is waited for.
        warm_up, repeats: number of rounds that are not timed, and that are.
        budget: seconds of all calls after which no further round begins.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(warm_up + repeats):
        if number > warm_up and sum(map(sum, seconds.values())) >= budget:
            break
        for name, call in calls.items():
            start = now(place)
            call()
            if number >= warm_up:
                seconds[name].append(now(place) - start)
    return seconds


def now(place: torch.device) -> float:
    """Return the time in seconds once the device has done its work."""
    if place.type == "cuda":
        torch.cuda.synchronize(place)
    return time.perf_counter()


def times_as_fast(faster: list[float], slower: list[float]) -> float:
    """Return the median over rounds of how many times the first takes within the second."""
    return statistics.median(after / before for before, after in zip(faster, slower, strict=True))
