"""The lines with which a command ends: what to run next, ready to paste."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

from sci_lightning.console import PlainConsole


def override(key: str, value: str | Path) -> str:
    """Return ``key=value`` as Hydra takes it: values with blanks, commas or brackets in quotes."""
    text = str(value)
    if not re.fullmatch(r"[\w./+~@%-]+", text):
        # in Hydra's quotes a backslash means itself, except before a quote
        text = "'" + re.sub(r"(\\*)('|$)", lambda match: 2 * match[1] + ("\\'" if match[2] else ""), text) + "'"
    return f"{key}={text}"


def nearest(path: str | Path) -> str:
    """Return a path relative to the working directory where it lies below it, else absolute."""
    absolute = os.path.abspath(path)
    relative = os.path.relpath(absolute)
    return absolute if relative.startswith("..") else relative


def invocation(command: str, *words: str, paths: Mapping[str, str | Path] | None = None) -> str:
    """Return a command line of this project, quoted for Hydra and the shell.

    Args:
        command: such as ``evaluate``.
        words: further words of the command line.
        paths: settings that are paths, by key; they come first.
    """
    settings = [override(key, nearest(path)) for key, path in (paths or {}).items()]
    return shlex.join([_python(), "-m", f"sci_lightning.{command}", *settings, *words])


def browser(path: str | Path) -> str:
    """Return a command line that opens a file in a browser, on any system."""
    return shlex.join([_python(), "-m", "webbrowser", Path(path).absolute().as_uri()])


def dashboard(folder: str | Path) -> str:
    """Return a command line that shows a folder's logs in TensorBoard: the one of the Python that runs this process."""
    own = Path(sys.executable).absolute().parent / "tensorboard"
    program = nearest(own) if shutil.which("tensorboard") is None and own.is_file() else "tensorboard"
    return shlex.join([program, "--logdir", nearest(folder)])


def print_next(console: PlainConsole, *lines: str) -> None:
    """Print command lines under the word ``next``, one a line; nothing in the rows of a sweep."""
    from sci_lightning.cli.composition import in_sweep  # loads Hydra, which not every command needs before its end

    if not in_sweep():
        for place, line in enumerate(lines):
            console.print(f"{'next:' if not place else '  or:'} {line}")


def _python() -> str:
    """``python`` where that starts the Python that runs this process, else its path."""
    own, there = Path(sys.executable).absolute(), shutil.which("python")
    return "python" if there is not None and Path(there).absolute().parent == own.parent else nearest(own)
