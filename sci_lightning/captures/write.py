"""Writing a captures file; it is read back and checked before it gets its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.read import FORMAT, FORMAT_VERSION, read_captures
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.hdf5_file import write_hdf5

ENDINGS = (".h5", ".hdf5")


def write_captures(path: str | Path, captures: Captures) -> Captures:
    """Write a captures file, unless :func:`read_captures` would refuse it.

    Images are compressed without loss. The scene is left out if it is unknown for every capture. Patterns of another
    size than the field's may wait for their registration.

    Args:
        path: the file, .h5 or .hdf5; it is written whole or not at all.
        captures: what to write.

    Returns:
        The captures as read back from the file.

    Raises:
        BadInput: the path has another ending or is a folder's, or the captures violate the format.
    """
    path = Path(path)
    if path.suffix not in ENDINGS or path.is_dir():
        raise BadInput(f"out={path}: a captures file ends in .h5 or .hdf5")
    attributes: dict[str, str | int | float | np.ndarray] = {"format": FORMAT, "format_version": FORMAT_VERSION}
    for name in ("bit_depth", "read_noise_dn", "full_well_e", "name", "surround"):
        if (value := getattr(captures, name)) not in (None, ""):
            attributes[name] = value
    if captures.verification is not None:
        attributes["verification"] = np.array(captures.verification, np.int64)
    if captures.sensor_to_modulator is not None:
        attributes["sensor_to_modulator"] = np.array(captures.sensor_to_modulator, np.float64)
    datasets = {name: getattr(captures, name) for name in ("patterns", "sequence", "measurement")}
    if not np.isnan(captures.scene).all():
        datasets["scene"] = captures.scene
    datasets |= {"aperture": captures.aperture, "exposure": captures.exposure}
    with atomic_write(path) as temporary:
        write_hdf5(temporary, attributes, {**datasets, "kind": captures.kind})
        written = read_captures(temporary, called=path, registered=captures.sensor_to_modulator is not None)
    return replace(written, name=captures.name or path.stem, path=path)
