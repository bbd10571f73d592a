"""The files of a name below a folder."""

from __future__ import annotations

import os
from fnmatch import fnmatchcase
from pathlib import Path

from sci_lightning.errors import BadInput

MOST_ENTRIES = 500_000
"""Files and folders that are looked at; a run has about thirty."""


def files_below(folder: str | Path, *patterns: str) -> list[Path]:
    """Return every file below a folder whose name fits a pattern such as ``seed*.json``, in the order of modification.

    Links to folders are not followed, and files that lie outside of the folder (links to them) are not returned.

    Raises:
        BadInput: more than ``MOST_ENTRIES`` files and folders.
    """
    folder = Path(folder)
    matches: list[tuple[float, str]] = []
    waiting, count = [str(folder)], 0
    while waiting:
        try:
            entries = list(os.scandir(waiting.pop()))
        except OSError:  # no folder, or one that may not be read
            continue
        count += len(entries)
        if count > MOST_ENTRIES:
            raise BadInput(f"{folder}: more than {MOST_ENTRIES:,} files; give the folder that the runs lie in")
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                waiting.append(entry.path)
            elif any(fnmatchcase(entry.name, pattern) for pattern in patterns) and is_inside(Path(entry.path), folder):
                matches.append((entry.stat().st_mtime, entry.path))
    return [Path(path) for _, path in sorted(matches)]


def is_inside(path: str | Path, folder: str | Path) -> bool:
    """Whether a path names a regular file that, all links followed, lies in the folder."""
    try:
        return Path(path).is_file() and Path(path).resolve().is_relative_to(Path(folder).resolve())
    except (OSError, RuntimeError):  # a loop of links
        return False
