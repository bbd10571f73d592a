"""Files and folders that a checkpoint names, or in which it lies: it may be a stranger's."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from sci_lightning.cli.next_command import override as quoted
from sci_lightning.console import PlainConsole, styled
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt, one_printable_line
from sci_lightning.runs.run_folder import is_first_process

PATHS = {"root", "val_root", "file", "photographs"}
"""What settings that name files or folders to read are called."""


def check_links(folder: Path) -> None:
    """Check that a run's folder can be gone on with although nobody said ``out=``: it may be a stranger's.

    Raises:
        BadInput: it has a link that leads out of it, over which other files would be written, or a name that would be
            obeyed.
    """
    if "${" in str(folder) or "'" in str(folder) or "\\" in str(folder):
        raise BadInput(f"{folder}: a name with ${{, ' or \\ would be obeyed, not read; rename the folder")
    real = folder.resolve()
    for place, folders, files in os.walk(real):
        for name in (*folders, *files):
            path = Path(place) / name
            if path.is_symlink() and not path.resolve().is_relative_to(real):
                raise BadInput(
                    f"{path}: a link that leads out of the run's folder, where other files would be overwritten; to "
                    f"go on there all the same, say so: out={folder}"
                )


def named_files(key: str, value: Any) -> Iterator[tuple[str, str]]:
    """Settings that name files to read, and what they name: by what they are called, and whatever looks like a path."""
    if isinstance(value, Mapping):
        for name, entry in value.items():
            yield from named_files(f"{key}.{name}" if key else str(name), entry)
    elif isinstance(value, list):
        for entry in value:
            yield from named_files(key, entry)
    elif (
        isinstance(value, str)
        and value != "1/T"  # an aperture
        and (key.rpartition(".")[2] in PATHS or "/" in value or "\\" in value or value.startswith((".", "~")))
    ):
        yield key, value


def check_paths(path: Path, named: Iterable[tuple[str, str]]) -> None:
    """Check the files and folders that a checkpoint names, and show them: it may be a stranger's, and they are read.

    Raises:
        BadInput: one that lies neither in the current folder nor in that of the run. Links count as what they lead to.
    """
    named = sorted(named)
    if others := elsewhere(path, named):
        raise BadInput(
            f"{path}: this training read files that lie neither in the current folder nor in the run's; if they are "
            f"yours, say so by repeating: {shlex.join(map(one_printable_line, others))}"
        )
    if named and is_first_process():
        shown = ", ".join(f"{key}={excerpt(value)}" for key, value in named)
        PlainConsole().say("as recorded in ", styled(path), f": reads {shown}")


def elsewhere(path: Path, named: Iterable[tuple[str, str]]) -> list[str]:
    """Return those of the files that a checkpoint names which have to be repeated, as overrides."""
    folder = path.resolve().parent
    own = [Path.cwd().resolve(), folder.parent if folder.name == "checkpoints" else folder]

    def is_own(name: str) -> bool:
        try:
            return any(Path(os.path.expanduser(name)).resolve().is_relative_to(folder) for folder in own)
        except (OSError, ValueError, RuntimeError):  # no name of a file
            return False

    return [quoted(key, value) for key, value in dict(named).items() if not is_own(value)]
