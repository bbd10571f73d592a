"""A captures file, written whole and read back before it gets its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sci_lightning.atomic_file import whole_file
from sci_lightning.captures.captures import Captures
from sci_lightning.captures.read import FORMAT, FORMAT_VERSION, read_captures
from sci_lightning.errors import BadInput

ENDINGS = (".h5", ".hdf5")


def write_captures(path: str | Path, captures: Captures) -> Captures:
    """Write a captures file; what :func:`read_captures` would refuse never gets the name ``path``.

    Images are compressed without loss. The scene is left out when none is known.

    Returns:
        what was written, as read back.

    Raises:
        BadInput: the name does not end in .h5 or .hdf5, or is a folder's; captures that break the format.
    """
    path = Path(path)
    if path.suffix not in ENDINGS or path.is_dir():
        raise BadInput(f"out={path}: a captures file ends in .h5 or .hdf5")
    attributes: dict[str, Any] = {"format": FORMAT, "format_version": FORMAT_VERSION}
    for name in ("bit_depth", "read_noise_dn", "full_well_e", "name"):
        if (value := getattr(captures, name)) not in (None, ""):
            attributes[name] = value
    datasets = {name: getattr(captures, name) for name in ("patterns", "sequence", "measurement")}
    if not np.isnan(captures.scene).all():
        datasets["scene"] = captures.scene
    datasets |= {"aperture": captures.aperture, "exposure": captures.exposure}
    with whole_file(path) as temporary:
        with h5py.File(temporary, "w") as file:
            file.attrs.update(attributes)
            for name, values in datasets.items():
                large = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if values.ndim > 2 else {}
                file.create_dataset(name, data=values, **large)
            file.create_dataset("kind", data=list(captures.kind), dtype=h5py.string_dtype())
        written = read_captures(temporary, called=path)
    return replace(written, name=captures.name or path.stem, path=path)
