"""The folder that a command writes: nobody else writes it at the same time, and one without a name is a new one."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import IO, Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from sci_lightning.cli.settings_check import Refused
from sci_lightning.errors import BadInput
from sci_lightning.runs.resume import check_nothing_lost

RANKS = ("RANK", "LOCAL_RANK", "SLURM_PROCID")
"""Variables in which launchers of several processes tell each its number."""

_locks: dict[Path, IO[str]] = {}
"""Lock files of this process, by folder."""

_made: dict[Path, list[Path]] = {}
"""What this process has made, by the folder that it needed: that folder itself, then those above it."""


def is_first_process() -> bool:
    """Whether this is the process that speaks and writes for all processes of a run."""
    return not any(os.environ.get(name, "0").strip("0") for name in RANKS)


@contextmanager
def run_folder(out: str | Path) -> Iterator[None]:
    """Keep a folder for this process, and remove what a killed process has left half-written in its checkpoints.

    The operating system gives the folder free when the process ends, however it ends. The other processes of the same
    run (of several devices) share the first one's.

    Raises:
        BadInput: another process writes there; the message says which.
    """
    if not is_first_process():
        yield
        return
    folder = Path(out).resolve()
    lock(folder)
    try:
        remove_leftovers(folder / "checkpoints")
        yield
    finally:
        unlock(folder)


def unlock(folder: Path) -> None:
    """Give a folder free that this process has locked; nothing happens to others."""
    file = _locks.pop(folder, None)
    if file is not None:
        (folder / ".lock").unlink(missing_ok=True)
        file.close()


def remove_if_refused(out: str | Path, job: str) -> None:
    """Remove the folder of a command that was refused, if this process made it and only Hydra has written into it.

    Args:
        out: the folder; those above it that this process made go with it when they are empty.
        job: the command's name, which is that of its log file.
    """
    folder = Path(out).resolve()
    if not is_first_process() or folder not in _made:
        return
    unlock(folder)
    written = [path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()]
    of_hydra = {folder / ".hydra" / f"{name}.yaml" for name in ("config", "hydra", "overrides")} | {
        folder / f"{job}.log"
    }
    if not of_hydra.issuperset(written):
        return
    for path in written:
        path.unlink(missing_ok=True)
    for path in (*sorted(filter(Path.is_dir, folder.rglob("*")), reverse=True), *_made.pop(folder)):
        try:
            path.rmdir()
        except OSError:  # somebody else's files, or another run's folder beside it
            return


def lock(folder: Path) -> None:
    """Lock a folder until the end of :func:`run_folder` or of the process; raises as that does."""
    path = folder / ".lock"
    while folder not in _locks:
        _make(folder, exist_ok=True)
        file = _lock_file(path)
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # unlike flock: not inherited by workers that live on
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


def remove_leftovers(checkpoints: Path) -> None:
    """Remove temporary files that processes were killed over; their names are those of ``atomic_file``."""
    for path in checkpoints.glob(".*.ckpt"):
        if re.fullmatch(r"\.(last|best)-\w{8}\.ckpt", path.name) and path.is_file() and not path.is_symlink():
            path.unlink(missing_ok=True)


class OwnFolder(Callback):
    """Takes the folder of a command before Hydra writes into it.

    A name with the time in it is that of a new folder: of commands that start in the same second all but one wait for
    the next.

    Raises:
        Refused: another process writes there, or a training lies there that would be overwritten.
    """

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        if not is_first_process():
            return
        try:
            while _is_new(config) and not _made_for(config):
                time.sleep(0.1)
                OmegaConf.clear_cache(config)  # which keeps the time
            folder = Path(config.hydra.run.dir).resolve()
            lock(folder)
            try:
                check_folder(folder, config)
            except BadInput:
                unlock(folder)
                raise
        except Exception as error:
            raise Refused from error

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        if _is_new(config) and not _made_for(config):
            raise Refused from BadInput(f"{config.out}: another sweep was started in this second; start it again")


def _is_new(config: DictConfig) -> bool:
    """Whether a command's folder is called after the time."""
    content = OmegaConf.to_container(config, resolve=False)
    return isinstance(content, dict) and "${now:" in str(content["out"])


def _made_for(config: DictConfig) -> bool:
    """Make a command's folder; False if it is there."""
    try:
        _make(Path(config.out).resolve())
    except FileExistsError:
        return False
    return True


def _make(folder: Path, exist_ok: bool = False) -> None:
    """Make a folder and those above it, and note which were not there."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=exist_ok)
    _made.setdefault(folder, missing) if missing else None


def check_folder(folder: Path, config: DictConfig) -> None:
    """Check that a command with this configuration overwrites no training; raises as ``check_nothing_lost`` does."""
    training = "resume" in config
    settings = {"resume": bool(config.resume), "ckpt_path": config.ckpt_path} if training else {}
    check_nothing_lost(folder, training, **settings)
