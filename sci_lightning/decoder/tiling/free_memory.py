"""How much memory is free where tensors are computed with."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import torch

MEMORY_INFORMATION = Path("/proc/meminfo")

CGROUP = (
    ("/sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
    ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)
"""Where the system says how much memory a container may use, how much it does, and, in ``memory.stat``, how much of
that holds files which it can read again."""


def free_memory(device: torch.device) -> int:
    """Return how many bytes a computation on a device can still take.

    On a processor it is what the system calls available, or what the container's limit leaves, whichever is less.
    """
    if device.type == "cuda":
        free, _ = torch.cuda.mem_get_info(device)
        return free + torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    bounds: list[int] = []
    with suppress(OSError, ValueError, StopIteration):
        lines = MEMORY_INFORMATION.read_text().splitlines()
        bounds.append(1024 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1]))
    for folder, limit, used, cached in CGROUP:
        with suppress(OSError, ValueError):
            taken = int(Path(folder, used).read_text()) - _counted(Path(folder, "memory.stat"), cached)
            bounds.append(max(0, int(Path(folder, limit).read_text()) - taken))
    if not bounds:
        with suppress(OSError, ValueError, AttributeError):
            bounds.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2)
    return min(bounds, default=8 * 2**30)


def _counted(path: Path, name: str) -> int:
    """Return the number beside a name in a list of the system's; 0 without it."""
    with suppress(OSError, ValueError, StopIteration):
        return int(next(line for line in path.read_text().splitlines() if line.startswith(f"{name} ")).split()[1])
    return 0
