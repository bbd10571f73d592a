"""HDF5 files from anywhere, read without leaving the file, and HDF5 files of our own, written whole.

HDF5 can name other files (external links, external storage, virtual datasets), declare datasets that nobody wrote, and
compress a gigabyte of nothing into a kilobyte. A file that came by e-mail gets none of that past :func:`read_dataset`.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.hdf5_heap import check_heaps
from sci_lightning.files.memory_bound import (
    LARGEST_RATIO,
    SMALL,
    UNCHECKED,
    check_stored,
    inflates_beyond,
    lzf_inflates_beyond,
)

LABELS = {1: "gzip", 2: "shuffle", 4: "szip", 5: "nbit", 6: "scaleoffset", 32000: "lzf"}
LZF = 32000
LZF_UNCHECKED = 8 * 2**20
"""Bytes of a dataset, and a sixteenth of them in the file, of which the worst takes seconds to inflate."""
SHUFFLE = h5py.h5z.FILTER_SHUFFLE
CHAINS = [(*before, *last) for before in ((), (SHUFFLE,)) for last in ((), (h5py.h5z.FILTER_DEFLATE,), (LZF,))]
"""Chains of filters that are read: at most one that compresses, and what it compresses is what is stored."""

MOST_OBJECTS = 10_000
"""Groups and datasets that are looked at in a file; captures files have nine, MATLAB files a few dozen."""

MAX_DEPTH = 32
"""Groups within groups; HDF5 looks for each from the top."""


@contextmanager
def open_hdf5(path: str | Path, called: str | Path | None = None, expected: str = "one") -> Iterator[h5py.File]:
    """Open an HDF5 file for reading.

    Args:
        path: the file.
        called: what error messages call it; None: its path.
        expected: what messages say that the file should be.

    Raises:
        BadInput: not an HDF5 file, damaged or truncated; also when HDF5 finds that out while the file is being read.
    """
    called = called or path
    try:
        if not h5py.is_hdf5(path):
            raise BadInput(f"{called}: not an HDF5 file, expected {expected}")
        with h5py.File(path, "r") as file:
            try:
                check_heaps(Path(path), file.id.get_create_plist().get_sizes()[1])
            except BadInput as error:
                raise BadInput(f"{called}: not a readable HDF5 file, damaged or truncated ({error})") from error
            yield file
    except (OSError, RuntimeError, KeyError) as error:  # what h5py makes of HDF5's errors
        raise BadInput(f"{called}: not a readable HDF5 file, damaged or truncated ({_first_line(error)})") from error


def hdf5_datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Return every dataset that lies in the file itself, in whichever group, by its path; links are passed over.

    Raises:
        BadInput: more than :data:`MOST_OBJECTS` names, or groups that are nested deeper than :data:`MAX_DEPTH`.
    """
    datasets: dict[str, h5py.Dataset] = {}
    seen = {h5py.h5o.get_info(file.id).addr}
    looked_at = 0
    waiting: list[tuple[str, h5py.Group, int]] = [("", file, 0)]
    while waiting:
        place, group, depth = waiting.pop()
        if depth > MAX_DEPTH:
            raise BadInput(f"{file.filename}: groups within groups, more than {MAX_DEPTH} deep; expected a few")
        for name in group:
            looked_at += 1
            if looked_at > MOST_OBJECTS:
                raise BadInput(f"{file.filename}: more than {MOST_OBJECTS} groups and datasets; expected a few")
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            item = group[name]
            address = h5py.h5o.get_info(item.id).addr
            if address in seen:  # a group may hold itself
                continue
            seen.add(address)
            if isinstance(item, h5py.Group):
                waiting.append((f"{place}{name}/", item, depth + 1))
            elif isinstance(item, h5py.Dataset) and _has_dtype(item):
                datasets[f"{place}{name}"] = item
    return datasets


def _has_dtype(item: h5py.Dataset) -> bool:
    """Whether NumPy has a name for the type of a dataset's values."""
    try:
        return item.dtype is not None
    except TypeError:
        return False


def own_dataset(file: h5py.File, name: str, expected: str = "a dataset") -> h5py.Dataset | None:
    """Return the dataset at the top of the file that has a name, None where there is none.

    Args:
        expected: what messages call it.

    Raises:
        BadInput: the name is a link or a group.
    """
    link = file.get(name, getlink=True)
    if link is None:
        return None
    if not isinstance(link, h5py.HardLink):
        raise BadInput(f"'{name}' is a link, expected {expected} in the file itself")
    item = file[name]
    if not isinstance(item, h5py.Dataset):
        raise BadInput(f"'{name}' is a group, expected {expected}")
    if not _has_dtype(item):
        raise BadInput(f"'{name}' holds values of a type that is not read, expected {expected}")
    return item


def check_dataset(name: str, item: h5py.Dataset) -> int:
    """Check that a dataset's values are in the file, and can be read within the bounds of memory_bound.py.

    Returns:
        how many bytes the values take in memory.

    Raises:
        BadInput: kept in another file, never written, larger than what is stored or than the memory allows, or
            compressed by a filter that is not installed.
    """
    if item.is_virtual or item.external:
        raise BadInput(f"'{name}' is kept in another file, expected a dataset in the file itself")
    if item.shape is None:
        raise BadInput(f"'{name}' is empty")
    plist = item.id.get_create_plist()
    filters = [plist.get_filter(index) for index in range(plist.get_nfilters())]
    for code, _, _, label in filters:
        if not h5py.h5z.filter_avail(code):
            label = label.decode(errors="replace") if isinstance(label, bytes) else label
            raise BadInput(
                f"'{name}' is stored by the HDF5 filter {label or 'number'} ({code}), which is not installed; "
                "save it with gzip or without compression"
            )
    declared = math.prod(item.shape) * item.id.get_type().get_size()
    stored = item.id.get_storage_size()
    unwritten = item.chunks is not None or not stored  # what nobody wrote is read as the fill value
    check_stored(f"'{name}' of shape {item.shape}", declared, stored, compressed=bool(filters) or unwritten)
    if item.chunks is not None:
        _check_chunks(name, item, declared, [(code, values) for code, _, values, _ in filters])
    return declared


def _check_chunks(name: str, item: h5py.Dataset, declared: int, chain: list[tuple[int, tuple[int, ...]]]) -> None:
    """Chunks are read whole: none may be much larger than its dataset, nor inflate to more than its own size."""
    codes = [code for code, _ in chain]
    filters = tuple(code for code in codes if code != h5py.h5z.FILTER_FLETCHER32)
    if filters not in CHAINS:  # others inflate more than once, or to what they say themselves
        known = [LABELS.get(code, str(code)) for code in filters]
        raise BadInput(
            f"'{name}' is stored by the HDF5 filters {', '.join(known)}, expected shuffle and one of gzip and lzf at "
            "most; save it with gzip or without compression"
        )
    deflated = h5py.h5z.FILTER_DEFLATE in filters
    size = math.prod(item.chunks) * item.id.get_type().get_size()
    if size > max(SMALL, 2 * declared):
        raise BadInput(f"'{name}' has chunks of shape {item.chunks}, larger than its shape {item.shape}")
    if LZF in filters:
        _check_lzf(name, item, declared, size, chain)
    # HDF5 inflates a chunk to whatever comes out of it, and only then looks at the size
    if deflated and LARGEST_RATIO * item.id.get_storage_size() > UNCHECKED:
        large: list[tuple[int, ...]] = []

        def note(chunk: Any) -> None:
            if LARGEST_RATIO * chunk.size > UNCHECKED:
                large.append(chunk.chunk_offset)

        item.id.chunk_iter(note)
        for offset in large:
            _, content = item.id.read_direct_chunk(offset)
            if inflates_beyond(content, size):
                raise BadInput(f"'{name}' has a chunk that inflates to more than its {size} bytes, expected its values")


def _check_lzf(
    name: str, item: h5py.Dataset, declared: int, size: int, chain: list[tuple[int, tuple[int, ...]]]
) -> None:
    """Check chunks of ``size`` bytes that are compressed by LZF.

    Its filter begins with as much memory as the file says, and begins again with a little more until a chunk fits: one
    that inflates to 88 times what is stored takes four thousand times the work.
    """
    codes = [code for code, _ in chain]
    place, checksum = codes.index(LZF), h5py.h5z.FILTER_FLETCHER32
    begins_with = chain[place][1][2:3]
    if declared > LZF_UNCHECKED and (not begins_with or begins_with[0] < size):
        raise BadInput(
            f"'{name}' is stored by the HDF5 filter lzf without the size of its chunks, which takes minutes to read; "
            "save it with gzip or without compression"
        )
    if item.id.get_storage_size() <= LZF_UNCHECKED // 16:
        return
    chunks: list[tuple[int, ...]] = []
    item.id.chunk_iter(lambda chunk: chunks.append(chunk.chunk_offset))
    last = -4 if checksum in codes[place + 1 :] else None  # four bytes behind what is compressed, or within it
    for offset in chunks:
        skipped, content = item.id.read_direct_chunk(offset)
        if not skipped >> place & 1 and lzf_inflates_beyond(content[:last], size + 4 * (checksum in codes)):
            raise BadInput(f"'{name}' has a chunk that inflates to more than its {size} bytes, expected its values")


def read_dataset(name: str, item: h5py.Dataset, dtype: Any = None) -> np.ndarray:
    """Read a dataset whole after :func:`check_dataset`, converted to ``dtype`` while it is read if one is given.

    Raises:
        BadInput: as :func:`check_dataset`; damaged.
    """
    check_dataset(name, item)
    try:
        return np.asarray(item[()] if dtype is None else item.astype(dtype)[()])
    except MemoryError as error:
        raise BadInput(f"'{name}' of shape {item.shape} does not fit in memory") from error
    except (OSError, RuntimeError, ValueError) as error:
        raise BadInput(f"'{name}' cannot be read, the file is damaged or truncated") from error


def write_hdf5(path: Path, attributes: Mapping[str, Any], datasets: Mapping[str, Any]) -> None:
    """Write numbers and strings as an HDF5 file; arrays of three and more dimensions are compressed without loss.

    The file is made in memory and then written in one go: a disk that is full while HDF5 writes crashes the process.

    Args:
        path: the file, which is overwritten.
        attributes: of the file.
        datasets: arrays, or sequences of strings, by name.

    Raises:
        OSError: the file cannot be written.
    """
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        file.attrs.update(attributes)
        for name, values in datasets.items():
            if not isinstance(values, np.ndarray):
                file.create_dataset(name, data=list(values), dtype=h5py.string_dtype())
                continue
            large = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if values.ndim > 2 else {}
            file.create_dataset(name, data=values, **large)
    with path.open("wb") as stream:
        stream.write(image.getbuffer())


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
