"""JSON Schemas (draft 2020-12) of the files that the program writes and reads; every field is described there.

    from sci_lightning.files.schemas import read_schema
    jsonschema.validate(json.loads(Path("report.json").read_text()), read_schema("report"))

Some schemas refer to others by their file names, ``report.json#/properties/verdict``; a validator needs these too.
HDF5 has no schema language: ``captures_file`` describes the outline of a captures file that :func:`outline` gives.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py

FOLDER = Path(__file__).parent

SCHEMAS = tuple(sorted(path.stem for path in FOLDER.glob("*.json")))
"""Names of all schemas."""


def read_schema(name: str) -> dict[str, Any]:
    """Return a schema.

    Args:
        name: one of ``SCHEMAS``, as in ``report``.

    Raises:
        KeyError: there is no such schema.
    """
    if name not in SCHEMAS:
        raise KeyError(f"no schema {name!r}; there are {', '.join(SCHEMAS)}")
    content: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return content


def outline(path: str | Path) -> dict[str, Any]:
    """Return an HDF5 file's attributes with their values, and the type and shape of its datasets, as plain data.

    Only for files that can be trusted; :func:`sci_lightning.captures.read_captures` checks those that cannot.

    Returns:
        ``{"attributes": {name: value}, "datasets": {name: {"dtype": "float32", "shape": [..]}}}``; the dtype of
        strings is ``string``.
    """
    with h5py.File(path) as file:
        attributes = {
            name: value.tolist() if hasattr(value, "tolist") else value for name, value in sorted(file.attrs.items())
        }
        datasets = {
            name: {
                "dtype": "string" if h5py.check_string_dtype(item.dtype) is not None else str(item.dtype),
                "shape": list(item.shape),
            }
            for name, item in sorted(file.items())
            if isinstance(item, h5py.Dataset)
        }
    return {"attributes": attributes, "datasets": datasets}
