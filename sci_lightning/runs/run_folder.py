"""The folder that a command writes: nobody else writes it at the same time, and one without a name is a new one."""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import IO

from sci_lightning.errors import BadInput

RANKS = ("RANK", "LOCAL_RANK", "SLURM_PROCID")
"""Variables in which launchers of several processes tell each its number."""

_locks: dict[Path, IO[str]] = {}
"""Lock files of this process, by folder."""

_found: dict[Path, dict[Path, bytes]] = {}
"""What Hydra's files of an earlier command held, by the folder that this process has locked."""

_made: dict[Path, list[Path]] = {}
"""What this process has made, by the folder that it needed: that folder itself, then those above it."""


def is_first_process() -> bool:
    """Whether this is the process that speaks and writes for all processes of a run."""
    return not any(os.environ.get(name, "0").strip("0") for name in RANKS)


@contextmanager
def run_folder(out: str | Path, wait: bool = False) -> Iterator[None]:
    """Keep a folder for this process.

    The operating system gives the folder free when the process ends, however it ends. The other processes of the same
    run (of several devices) share the first one's.

    Args:
        out: the folder.
        wait: until another process that writes there has ended.

    Raises:
        BadInput: another process writes there; the message says which.
    """
    if not is_first_process():
        yield
        return
    folder = Path(out).resolve()
    lock(folder, wait)
    try:
        yield
    finally:
        unlock(folder)


def unlock(folder: Path) -> None:
    """Give a folder free that this process has locked; nothing happens to others."""
    file = _locks.pop(folder, None)
    if file is not None:
        (folder / ".lock").unlink(missing_ok=True)
        file.close()


def undo_if_refused(out: str | Path, job: str) -> None:
    """Undo what Hydra has written for a command that was refused.

    In the folder of an earlier command its files get back what they held. A folder that this process made is removed if
    nothing else lies in it.

    Args:
        out: the folder; those above it that this process made go with it when they are empty.
        job: the command's name, which is that of its log file.
    """
    folder = Path(out).resolve()
    if not is_first_process():
        return
    earlier = _found.pop(folder, {})
    for path in (*_of_hydra(folder), folder / f"{job}.log"):
        if path in earlier:
            path.write_bytes(earlier[path])
        elif not path.is_symlink() and folder not in _made:
            path.unlink(missing_ok=True)
    if folder not in _made:
        return
    unlock(folder)
    written = [path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()]
    if not {*_of_hydra(folder), folder / f"{job}.log"}.issuperset(written):
        return
    for path in written:
        path.unlink(missing_ok=True)
    for path in (*sorted(filter(Path.is_dir, folder.rglob("*")), reverse=True), *_made.pop(folder)):
        try:
            path.rmdir()
        except OSError:  # somebody else's files, or another run's folder beside it
            return


def lock(folder: Path, wait: bool = False) -> None:
    """Lock a folder until the end of :func:`run_folder` or of the process; raises as that does."""
    path = folder / ".lock"
    while folder not in _locks:
        make_folder(folder, exist_ok=True)
        file = _lock_file(path)
        try:
            # unlike flock: not inherited by workers that live on
            fcntl.lockf(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError) as error:
            file.seek(0)
            holder = file.read(300).strip() or "another process"
            file.close()
            raise BadInput(f"{folder}: {holder} is writing there; give another out=, or wait until it ends") from error
        except OSError:  # a file system without locks
            pass
        try:
            mine = os.path.samestat(os.fstat(file.fileno()), path.stat())
        except FileNotFoundError:
            mine = False
        if not mine:  # its last holder has just removed it
            file.close()
            continue
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}, since {datetime.now():%Y-%m-%d %H:%M:%S},\n")
        file.flush()
        _locks[folder] = file
        present = [path for path in (*_of_hydra(folder), *folder.glob("*.log")) if path.is_file()]
        _found[folder] = {path: path.read_bytes() for path in present if not path.is_symlink()}


def _of_hydra(folder: Path) -> list[Path]:
    """Return the files in which Hydra notes a command."""
    return [folder / ".hydra" / f"{name}.yaml" for name in ("config", "hydra", "overrides")]


def is_locked(folder: Path) -> bool:
    """Return whether another process writes a folder; nothing is created."""
    path = folder / ".lock"
    if not path.is_file() or path.is_symlink():
        return False
    with path.open("r+") as file:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # given free again when the file is closed
        except (BlockingIOError, PermissionError):
            return True
        except OSError:  # a file system without locks
            return False
    return False


def _lock_file(path: Path) -> IO[str]:
    """Open the lock file; never what a link of that name leads to, which would be emptied."""
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
        if not stat.S_ISREG(os.fstat(number).st_mode):
            os.close(number)
            raise OSError(errno.EEXIST, "not a file")
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EEXIST, errno.EISDIR, errno.ENXIO):
            raise BadInput(f"{path}: a link or no file, expected the lock of a run; remove it") from error
        raise
    return os.fdopen(number, "r+")


def make_folder(folder: Path, exist_ok: bool = False) -> None:
    """Make a folder and those above it, and note which were not there."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=exist_ok)
    _made.setdefault(folder, missing) if missing else None
