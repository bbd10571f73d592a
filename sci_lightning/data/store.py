"""Clips that are decoded once into memory-mapped files, so that reading a random crop takes microseconds."""

from __future__ import annotations

import hashlib
import io
import math
import os
import struct
import sys
import zlib
from collections.abc import Callable, Iterable
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.lib import format as npy
from rich.progress import track

from sci_lightning.console import PlainConsole
from sci_lightning.data.reader import frame_files, read_frames
from sci_lightning.errors import BadInput, as_machine_failure
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.npy_file import npy_header

TRAILER = struct.Struct("<8sII")
MARK = b"SCI-CRC\n"
"""A stored clip ends with this and the checksums of its header and of its pixels; NumPy reads it as if it did not."""
BLOCK = 2**20
"""Number of bytes whose checksum is computed at a time."""

Layout: TypeAlias = tuple[tuple[int, int, int], int]
"""Shape (F, H, W) of a stored clip, and the position of its first pixel in bytes."""


class ClipStore:
    """The clips of a list of files and folders, each a read-only uint8 ``(F, H, W)`` array of luma.

    In colour it is ``(3 F, H, W)``: red, green and blue of the first frame, then of the next.

    Every clip is decoded once into an ``.npy`` file of the store folder. The file is named after a hash
    of the clip's path, size and modification time: what was decoded by an earlier or an interrupted
    run is used again, and a clip that changed is decoded anew. Files appear whole or not at all, also after
    a power cut, so processes may fill one store at the same time. Behind the pixels lie two checksums (CRC-32): that
    of the header is verified at every start, that of the pixels when a process first opens the clip, which
    reads it whole, once. A stored clip that is damaged is decoded anew, with one line on stderr.
    At most ``open_maps`` maps are kept open, so that neither memory nor file descriptors grow with the number of
    clips. The store can be sent to worker processes.

    Args:
        clips: what :func:`~sci_lightning.data.reader.find_clips` lists.
        store: the folder to decode into; by default ``sci_lightning/clips`` in the user's cache folder
            (``$XDG_CACHE_HOME``, else ``~/.cache``). It may be deleted at any time between runs.
        open_maps: how many clips stay mapped; opening one again costs about 0.1 ms.
        colour: whether clips are kept in colour.

    Raises:
        BadInput: a clip cannot be read, or the store folder cannot be written.
        MachineFailure: the disk is full.
    """

    def __init__(
        self, clips: Iterable[Path], store: str | Path | None = None, *, open_maps: int = 128, colour: bool = False
    ) -> None:
        self.clips = list(clips)
        self.colour = colour
        self.open_maps = open_maps
        folder = Path(os.path.expanduser(store)) if store is not None else _default_folder()
        self._verified: set[int] = set()
        self._files = [folder / f"{_fingerprint(clip)}{'-rgb' * colour}.npy" for clip in self.clips]
        quiet = all(map(_layout, self._files)) or os.environ.get("LOCAL_RANK", "0") != "0"
        todo = list(zip(self.clips, self._files, strict=True))
        bar = track(todo, "Storing clips", console=PlainConsole(stderr=True), disable=quiet)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._layouts = [_layout(file) or _decode(clip, file, colour) for clip, file in bar]
        except OSError as error:
            if failure := as_machine_failure(error, folder):
                raise failure from error
            reason = error.strerror or error
            raise BadInput(f"{folder}: cannot store clips ({reason}); give another store folder") from error

    def __len__(self) -> int:
        return len(self.clips)

    def __getitem__(self, index: int) -> np.ndarray:
        """Return the clip at ``index``, mapped into memory: read-only uint8 ``(F, H, W)``."""
        return self._map(index)

    @cached_property
    def _map(self) -> Callable[[int], np.ndarray]:
        @lru_cache(self.open_maps)
        def open_map(index: int) -> np.ndarray:
            if index not in self._verified:
                self._verify(index)
            shape, offset = self._layouts[index]
            return np.memmap(self._files[index], np.uint8, "r", offset, shape)

        return open_map

    def _verify(self, index: int) -> None:
        """Compare the pixels of a stored clip with their checksum; decode the clip anew where they differ."""
        clip, file, layout = self.clips[index], self._files[index], self._layouts[index]
        if _layout(file) != layout or _checksum(file, layout) != _trailer(file)[1]:
            print(f"{file}: damaged, {clip} is decoded anew", file=sys.stderr)
            if (anew := _write(clip, file, self.colour)) != layout:
                raise BadInput(
                    f"{clip}: changed while it was in use, from {layout[0]} to {anew[0]} (F, H, W); run again"
                )
        self._verified.add(index)

    def __getstate__(self) -> dict[str, object]:
        return {
            name: value for name, value in vars(self).items() if name != "_map"
        }  # maps are not sent to other processes

    @property
    def shapes(self) -> list[tuple[int, int, int]]:
        """Shapes (F, H, W) of all clips, without opening any."""
        planes = 3 if self.colour else 1
        return [(count // planes, height, width) for (count, height, width), _ in self._layouts]


def _default_folder() -> Path:
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "sci_lightning" / "clips"


def _fingerprint(clip: Path) -> str:
    """Return a hash of a clip's path, size and modification time (for a folder: of all frames)."""
    clip = clip.resolve()
    digest = hashlib.sha256()
    try:
        for file in frame_files(clip) if clip.is_dir() else [clip]:
            stat = file.stat()
            digest.update(f"{file}\0{stat.st_size}\0{stat.st_mtime_ns}\n".encode(errors="surrogateescape"))
    except OSError as error:
        raise BadInput(f"{clip}: cannot be read ({error.strerror})") from error
    return digest.hexdigest()[:32]


def _layout(file: Path) -> Layout | None:
    """Return the layout of a stored clip; None if it is missing or damaged."""
    try:
        with file.open("rb") as stream:
            shape, dtype = npy_header(stream)
            offset = stream.tell()
            stream.seek(0)
            header = zlib.crc32(stream.read(offset))
        if len(shape) != 3 or dtype != np.uint8 or header != _trailer(file)[0]:
            return None
        return (shape, offset) if file.stat().st_size == offset + math.prod(shape) + TRAILER.size else None
    except Exception:  # a damaged header leads NumPy anywhere
        return None


def _decode(clip: Path, file: Path, colour: bool) -> Layout:
    """Decode a clip as :func:`_write` does, with a line on stderr if a damaged stored clip is replaced."""
    if file.exists():
        print(f"{file}: damaged, {clip} is decoded anew", file=sys.stderr)
    return _write(clip, file, colour)


def _trailer(file: Path) -> tuple[int, int]:
    """Return the checksums of header and pixels at the end of a stored clip."""
    with file.open("rb") as stream:
        stream.seek(-TRAILER.size, os.SEEK_END)
        mark, header, pixels = TRAILER.unpack(stream.read())
    if mark != MARK:
        raise ValueError(f"{file}: no checksums")
    return header, pixels


def _checksum(file: Path, layout: Layout) -> int:
    """Return the CRC-32 of the pixels, computed block by block."""
    shape, offset = layout
    checksum, left = 0, math.prod(shape)
    with file.open("rb") as stream:
        stream.seek(offset)
        while left > 0 and (block := stream.read(min(left, BLOCK))):
            checksum, left = zlib.crc32(block, checksum), left - len(block)
    return checksum


def _write(clip: Path, file: Path, colour: bool) -> Layout:
    """Decode ``clip`` into ``file`` with one frame in memory at a time."""
    with atomic_write(file) as temporary, temporary.open("wb") as stream:
        stream.write(_header((0, 0, 0)))  # a placeholder: the number of frames is known at the end
        count, size, pixels = 0, (0, 0), 0
        for frame in read_frames(clip, colour):
            content = frame.tobytes()
            stream.write(content)
            pixels = zlib.crc32(content, pixels)
            count, size = count + (3 if colour else 1), frame.shape[-2:]
        header = _header((count, *size))
        stream.write(TRAILER.pack(MARK, zlib.crc32(header), pixels))
        stream.seek(0)
        stream.write(header)
    return (count, *size), len(header)


def _header(shape: tuple[int, int, int]) -> bytes:
    # 128 bytes for any shape: numpy pads headers to a multiple of 64
    stream = io.BytesIO()
    npy.write_array_header_1_0(stream, {"descr": "|u1", "fortran_order": False, "shape": shape})
    return stream.getvalue()
