"""Clips decoded once into memory-mapped files, so that a random crop costs microseconds."""

from __future__ import annotations

import hashlib
import math
import os
import uuid
from collections.abc import Callable, Iterable
from functools import cached_property, lru_cache
from pathlib import Path
from typing import BinaryIO, TypeAlias

import numpy as np
from numpy.lib import format as npy
from rich.progress import track

from sci_lightning.console import PlainConsole
from sci_lightning.data.reader import frame_files, read_frames
from sci_lightning.errors import BadInput

Layout: TypeAlias = tuple[tuple[int, int, int], int]
"""(F, H, W) of a stored clip, and the byte where its pixels start."""


class ClipStore:
    """The clips of a list of files and folders, each a read-only uint8 ``(F, H, W)`` array of luma.

    Every clip is decoded once into an ``.npy`` file of the store folder. The file is named after a hash
    of the clip's path, size and modification time: what was decoded by an earlier or an interrupted
    run is used again, and a clip that changed is decoded anew. Files appear whole or not at all, so
    processes may fill one store at the same time. At most ``open_maps`` maps are kept open, so that neither
    memory nor file descriptors grow with the number of clips. The store can be sent to worker processes.

    Args:
        clips: what :func:`~sci_lightning.data.reader.find_clips` lists.
        store: the folder to decode into; by default ``sci_lightning/clips`` in the user's cache folder
            (``$XDG_CACHE_HOME``, else ``~/.cache``). It may be deleted at any time between runs.
        open_maps: how many clips stay mapped; opening one again costs about 0.1 ms.

    Raises:
        BadInput: a clip cannot be read, or the store folder cannot be written.
    """

    def __init__(self, clips: Iterable[Path], store: str | Path | None = None, *, open_maps: int = 128) -> None:
        self.clips = list(clips)
        self.open_maps = open_maps
        folder = Path(store).expanduser() if store is not None else _default_folder()
        self._files = [folder / f"{_fingerprint(clip)}.npy" for clip in self.clips]
        quiet = all(map(_layout, self._files)) or os.environ.get("LOCAL_RANK", "0") != "0"
        todo = list(zip(self.clips, self._files, strict=True))
        bar = track(todo, "Storing clips", console=PlainConsole(stderr=True), disable=quiet)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._layouts = [_layout(file) or _write(clip, file) for clip, file in bar]
        except OSError as error:
            reason = error.strerror or error
            raise BadInput(f"{folder}: cannot store clips ({reason}); give another store folder") from error

    def __len__(self) -> int:
        return len(self.clips)

    def __getitem__(self, index: int) -> np.ndarray:
        """The clip at ``index``, mapped into memory: read-only uint8 ``(F, H, W)``."""
        return self._map(index)

    @cached_property
    def _map(self) -> Callable[[int], np.ndarray]:
        @lru_cache(self.open_maps)
        def open_map(index: int) -> np.ndarray:
            shape, offset = self._layouts[index]
            return np.memmap(self._files[index], np.uint8, "r", offset, shape)

        return open_map

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if name != "_map"}  # maps stay here

    @property
    def shapes(self) -> list[tuple[int, int, int]]:
        """(F, H, W) of every clip, without opening any."""
        return [shape for shape, _ in self._layouts]


def _default_folder() -> Path:
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "sci_lightning" / "clips"


def _fingerprint(clip: Path) -> str:
    """Changes when the clip's place, size or modification time does (for a folder: any frame's)."""
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
    """The layout of a stored clip; None if it is missing or damaged."""
    try:
        with file.open("rb") as stream:
            npy.read_magic(stream)
            shape, _, dtype = npy.read_array_header_1_0(stream)
            offset = stream.tell()
            size = stream.seek(0, os.SEEK_END)
    except (OSError, ValueError):
        return None
    if len(shape) != 3 or dtype != np.uint8 or size != offset + math.prod(shape):
        return None
    return shape, offset


def _write(clip: Path, file: Path) -> Layout:
    """Decodes ``clip`` into ``file`` with one frame in memory at a time."""
    temporary = file.with_name(f".{uuid.uuid4().hex}.tmp")
    try:
        with temporary.open("xb") as stream:
            _write_header(stream, (0, 0, 0))  # holds the place: the number of frames is known at the end
            count, size = 0, (0, 0)
            for frame in read_frames(clip):
                stream.write(frame.tobytes())
                count, size = count + 1, frame.shape
            stream.seek(0)
            _write_header(stream, (count, *size))
            offset = stream.tell()
        os.replace(temporary, file)
    finally:
        temporary.unlink(missing_ok=True)
    return (count, *size), offset


def _write_header(stream: BinaryIO, shape: tuple[int, int, int]) -> None:
    # 128 bytes for any shape: numpy pads headers to a multiple of 64
    npy.write_array_header_1_0(stream, {"descr": "|u1", "fortran_order": False, "shape": shape})
