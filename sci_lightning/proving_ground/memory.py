"""How much memory a piece of work takes at its peak."""

from __future__ import annotations

import resource
from pathlib import Path

STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def forget_peak() -> None:
    """Begin anew; where the system cannot (other than Linux), the peak stays that of the whole process."""
    try:
        FORGET.write_text("5")
    except OSError:
        return


def peak_mib() -> float:
    """The most that this process had resident since, MiB."""
    try:
        (line,) = (line for line in STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    except (OSError, ValueError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
