"""Writing a homography into what was registered: a captures file, or the ``captures.yaml`` of a folder."""

from __future__ import annotations

import io
import re
from pathlib import Path

import h5py
import numpy as np
import yaml

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.pack import assemble_captures
from sci_lightning.captures.read import FORMAT_VERSION, read_captures
from sci_lightning.captures.recipe import FILE, read_recipe
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.yaml_file import read_yaml

KEY = "sensor_to_modulator"


def read_unregistered(path: str | Path, again: bool = False) -> Captures:
    """Read a captures file, or the folder of one that is not packed yet, whose patterns need not be registered.

    Args:
        path: a captures file, or a folder with ``captures.yaml``.
        again: whether it may have a homography already.

    Raises:
        BadInput: it cannot be read, or has a homography already.
    """
    path = Path(path)
    if path.is_dir():
        captures = assemble_captures(path, registered=False)
        written, key = path / FILE, KEY
    else:
        captures = read_captures(path, registered=False)
        written, key = path, f"attribute '{KEY}'"
    if captures.sensor_to_modulator is not None and not again:
        raise BadInput(f"{written}: has a homography already ({key}); again=true finds it anew")
    return captures


def write_homography(path: str | Path, matrix: np.ndarray) -> Path:
    """Write a homography into a captures file or into a folder's ``captures.yaml``, whole or not at all.

    Everything else in the file stays as it is; a captures file becomes one of version 2.

    Args:
        path: a captures file, or a folder with ``captures.yaml``.
        matrix: (3, 3).

    Returns:
        the file that was written.

    Raises:
        BadInput: the file would be refused afterwards, or cannot be written.
        MachineFailure: the disk is full.
    """
    path = Path(path)
    if path.is_dir():
        return _into_recipe(path, matrix)
    content = io.BytesIO(path.read_bytes())  # in memory, as a disk that is full while HDF5 writes crashes the process
    with h5py.File(content, "r+") as file:
        file.attrs[KEY] = np.array(matrix, np.float64)
        file.attrs["format_version"] = FORMAT_VERSION
    with atomic_write(path) as temporary:
        temporary.write_bytes(content.getbuffer())
        read_captures(temporary, called=path)
    return path


def _into_recipe(folder: Path, matrix: np.ndarray) -> Path:
    recipe = folder / FILE
    rows = [[float(number) for number in row] for row in matrix]
    wanted = {**read_recipe(folder).top.values, KEY: rows}
    text = re.sub(rf"^{KEY}:.*\n?(?:(?:[ \t]+\S.*|-.*|\].*)\n?)*", "", recipe.read_text(encoding="utf-8"), flags=re.M)
    line = f"{KEY}: [{', '.join(str(row) for row in rows)}]  # found by captures register\n"
    with atomic_write(recipe) as temporary:
        temporary.write_text(text + ("" if text.endswith("\n") else "\n") + line, encoding="utf-8")
        if not _says(temporary, wanted):  # a file in braces, for instance: its comments are lost
            temporary.write_text(yaml.safe_dump(wanted, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return recipe


def _says(path: Path, wanted: dict[str, object]) -> bool:
    try:
        return bool(read_yaml(path) == wanted)
    except BadInput:
        return False
