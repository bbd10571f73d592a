"""Files that are whole or absent: written beside their place, then renamed into it."""

from __future__ import annotations

import errno
import os
import re
import socket
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from sci_lightning.errors import BadInput, as_machine_failure

ABANDONED_AFTER = 24 * 3600.0
"""Seconds without a change after which a temporary file is abandoned, whoever wrote it: no write takes a day."""

WRONG_PLACE = (
    *(errno.ENOENT, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.ENAMETOOLONG, errno.EINVAL),
    *(errno.EACCES, errno.EPERM, errno.EROFS, errno.ELOOP),
)
"""Error numbers that say that no file can be written to the path that was given."""


@contextmanager
def atomic_write(path: str | Path, among_many: bool = False) -> Iterator[Path]:
    """Give a temporary path in the folder of ``path``; rename it to ``path`` on success, remove it on failure.

    The folder is made when needed. The temporary name keeps the ending, which some writers look at. The file's content
    and then its name are on the disk (fsync) before this returns, so that a power cut leaves the old file or the new.
    A process that is killed cannot remove its temporary file: the next write to the same ``path`` does.

    Args:
        path: of the file.
        among_many: the temporary file lies in a folder ``.new`` below that of ``path``. That folder is listed by every
            write, which a folder that collects thousands of files would make slow.

    Raises:
        BadInput: no file can be written there: the path is a folder's, its parent is a file, the name is too long,
            the folder is read-only.
        MachineFailure: the disk is full or broken. What was at ``path`` before is unchanged.
    """
    path = Path(path)
    temporary = _temporary(path, ".new" if among_many else "")
    try:
        yield temporary
        with temporary.open("rb+") as written:
            os.fsync(written.fileno())
        temporary.chmod(0o666 & ~_umask())
        os.replace(temporary, path)
        sync_folder(path.parent)
    except Exception as error:
        if failure := as_machine_failure(error, path):
            raise failure from error
        raise
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def check_writable(path: str | Path) -> None:
    """Check before long work that its result can be written to a path; the path's folder is made when needed.

    Raises:
        BadInput, MachineFailure: as :func:`atomic_write`.
    """
    _temporary(Path(path)).unlink()


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where the file system knows how to."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _temporary(path: Path, below: str = "") -> Path:
    """Make the temporary file of ``path`` and remove those that killed processes left; see :func:`_abandoned`."""
    folder = path.parent / below
    try:
        if path.is_dir():
            raise BadInput(f"{path}: is a folder, expected the name of a file to write")
        folder.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError):
            path.lstat()  # raises at once, and not after hours of work, if the name is too long
        for abandoned in folder.glob(f".*.{_digest(path)}.*"):
            if _abandoned(abandoned):
                abandoned.unlink(missing_ok=True)
        suffix = path.suffix if len(path.suffix) <= 16 else ""
        start = path.stem.encode(errors="surrogateescape")[:60].decode(errors="ignore")
        name = f".{start}.{_digest(path)}.{_machine()}-{os.getpid()}-{uuid4().hex[:8]}.part{suffix}"
        temporary = folder / name
        temporary.touch(0o600, exist_ok=False)
    except OSError as error:
        if failure := as_machine_failure(error, path):
            raise failure from error
        if error.errno in WRONG_PLACE:
            reason = (error.strerror or str(error)).lower()
            raise BadInput(f"{path}: no file can be written there ({reason}); give another place") from error
        raise
    return temporary


def _abandoned(temporary: Path) -> bool:
    """Whether a temporary file is from a process of this machine that has ended, or has not changed for a day."""
    parts = re.search(r"\.([0-9a-f]{8})-(\d+)-[0-9a-f]{8}\.part[^/]*$", temporary.name)
    if parts is None:
        return False
    try:
        if time.time() - temporary.stat().st_mtime > ABANDONED_AFTER:
            return True
    except OSError:
        return False  # renamed or removed by its writer in the meantime
    return parts[1] == _machine() and not _runs(int(parts[2]))


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # somebody else's
        return True
    return True


def _digest(path: Path) -> str:
    """Eight hexadecimal digits of the file's name: which target a temporary file belongs to."""
    return f"{zlib.crc32(path.name.encode(errors='surrogateescape')):08x}"


def _machine() -> str:
    """Eight hexadecimal digits of the host and, on Linux, the container: process numbers mean something only there."""
    namespace = 0
    with suppress(OSError):
        namespace = os.stat("/proc/self/ns/pid").st_ino
    return f"{zlib.crc32(f'{socket.gethostname()} {namespace}'.encode()):08x}"


def _umask() -> int:
    """Return the process's umask, which is not applied to the temporary file (only its owner can read that)."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
