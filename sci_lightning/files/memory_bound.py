"""How large the arrays may be that a file declares: checked before anything of that size is allocated or read.

A file of a few kilobytes can declare terabytes: in a header, as a data set that was never written, or compressed. So
every reader compares what a file declares with what it holds, and both with this machine's memory:

- uncompressed data must be there, byte for byte;
- compressed data cannot be more than :data:`LARGEST_RATIO` times what is stored, beyond :data:`SMALL` bytes;
- all arrays that are read together must fit into :data:`MEMORY_SHARE` of the memory.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput

MEMORY_SHARE = 0.5
"""Part of this machine's memory (or of the container's) that the arrays of one file may take."""

SMALL = 64 * 2**20
"""Bytes up to which a file may declare more than it stores: empty and even images compress well."""

LARGEST_RATIO = 1100
"""Bytes of content per stored byte; deflate, the best compressor that is read, cannot reach 1033."""

UNCHECKED = 4 * SMALL
"""Bytes that compressed data may inflate to without being looked at: a lie wastes no more than these."""

BLOCK = 2**20
"""Bytes that are inflated at a time to see how many there are."""

LZF_MADE = [c + 1 if c < 32 else (c >> 5) + 2 for c in range(256)]
LZF_TAKEN = [c + 2 if c < 32 else 2 if c < 224 else 3 for c in range(256)]
"""Bytes that come out of an LZF instruction, and bytes that it takes, by its first."""

CGROUP_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def memory_bound() -> int:
    """Return how many bytes the arrays of one file may take on this machine."""
    limits = [64 * 2**30]  # where the system does not say how much memory there is
    with suppress(OSError, ValueError, AttributeError):
        limits = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    for place in CGROUP_LIMITS:
        with suppress(OSError, ValueError):
            limits.append(int(Path(place).read_text()))
    return int(MEMORY_SHARE * min(limits))


def check_memory(where: str, declared: int) -> None:
    """Refuse to read ``declared`` bytes that do not fit into :func:`memory_bound`.

    Args:
        where: the file and what of it, for the message.

    Raises:
        BadInput: more than the bound.
    """
    if declared > (bound := memory_bound()):
        raise BadInput(
            f"{where} declares {readable_bytes(declared)}, at most {readable_bytes(bound)} may be read "
            f"({MEMORY_SHARE:.0%} of this machine's memory); make the file smaller or use a machine with more memory"
        )


def check_stored(where: str, declared: int, stored: int, *, compressed: bool) -> None:
    """Refuse ``declared`` bytes of which a file stores too few to be true, then as :func:`check_memory`.

    Args:
        where: the file and what of it, for the message.
        declared: bytes in memory by the header.
        stored: bytes in the file.
        compressed: whether stored bytes may stand for more of them.

    Raises:
        BadInput: less is stored than declared, or more is declared than compression or the memory allows.
    """
    if not compressed and stored < declared:
        raise BadInput(f"{where} declares {declared} bytes, the file holds {stored} of them, damaged or truncated")
    if declared > max(SMALL, LARGEST_RATIO * stored):
        raise BadInput(
            f"{where} declares {readable_bytes(declared)}, but the file stores only {readable_bytes(stored)} for it; "
            "expected data that was written"
        )
    check_memory(where, declared)


def inflates_beyond(content: bytes | memoryview, size: int) -> bool:
    """Whether zlib-compressed bytes inflate to more than ``size``, found without keeping what comes out.

    What is damaged inflates to as much as comes before the damage.
    """
    inflater = zlib.decompressobj()
    total = 0
    try:
        while content and not inflater.eof:
            total += len(inflater.decompress(content, BLOCK))
            if total > size:
                return True
            content = inflater.unconsumed_tail
    except zlib.error:
        pass
    return False


def lzf_inflates_beyond(content: bytes | memoryview, size: int) -> bool:
    """Whether bytes compressed by LZF inflate to more than ``size``, found without inflating them.

    Source: Lehmann, "LibLZF", lzf_d.c: a byte below 32 is followed by so many and one more bytes as they are; any other
    one holds a length in its upper three bits (7: and in the next byte), and is followed by a place to copy from.
    """
    place = total = 0
    try:
        while total <= size:
            control = content[place]
            total += LZF_MADE[control]
            place += LZF_TAKEN[control]
            if control >= 224:
                total += content[place - 2]
    except IndexError:  # the end
        pass
    return total > size


def readable_bytes(count: int) -> str:
    """``1536`` as ``1.5 KiB``."""
    number = float(count)
    for unit in ("bytes", "KiB", "MiB", "GiB"):
        if number < 1024:
            return f"{number:.0f} {unit}" if unit == "bytes" else f"{number:.1f} {unit}"
        number /= 1024
    return f"{number:.1f} TiB"


def check_field(frames: int | None, size: Sequence[int] | int | None, where: str = "") -> None:
    """Refuse T frames of H x W pixels of which a few copies do not fit into this machine's memory.

    Args:
        frames, size: T and (H, W) in pixels, or the side of a square; None: not known.
        where: what says so, for the message.

    Raises:
        BadInput: more than a quarter of the memory.
    """
    if frames is None or size is None:
        return
    height, width = (size, size) if isinstance(size, int) else size
    needed, limit = 4 * frames * height * width, memory_bound() // 2
    if needed > limit:
        raise BadInput(
            f"{where}frames={frames} size=[{height},{width}]: one video takes {needed / 2**30:.1f} GiB in float32, "
            f"this machine has room for {limit / 2**30:.1f} GiB; give fewer frames or a smaller size"
        )


def check_fields(content: Any, where: str = "") -> None:
    """Refuse an encoder whose masks and maps together do not fit into this machine's memory.

    Args:
        content: its plain configuration: in every mapping ``size`` and ``tile`` are (H, W) in pixels, of ``frames``
            frames, of one where it names none.
        where: what says so, for the message.

    Raises:
        BadInput: more than a quarter of the memory.
    """
    needed = 0
    for section in _mappings(content):
        frames = section.get("frames")
        frames = frames if isinstance(frames, int) else 1
        sides = [section[key] for key in ("size", "tile") if _is_size(section.get(key))]
        for height, width in sides:
            check_field(frames, (height, width), where)
        needed += max((4 * frames * height * width for height, width in sides), default=0)
    if needed > (limit := memory_bound() // 2):
        raise BadInput(
            f"{where}its masks and maps take {needed / 2**30:.1f} GiB, this machine has room for {limit / 2**30:.1f} "
            "GiB; give fewer of them, or smaller ones"
        )


def _is_size(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) == 2 and all(isinstance(side, int) for side in value)


def _mappings(content: Any) -> Iterator[Mapping[str, Any]]:
    if isinstance(content, Mapping):
        yield content
        content = list(content.values())
    if isinstance(content, (list, tuple)):
        for value in content:
            yield from _mappings(value)
