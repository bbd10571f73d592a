"""Captures files, right ones and such as a user might bring."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

SHAPE = (3, 4, 5, 6)
"""N, T, H, W."""


def content(**changes: Any) -> dict[str, Any]:
    """Datasets and attributes (``attrs``) of a right file of three captures; a change to None leaves one out."""
    count, slots, height, width = SHAPE
    random = np.random.default_rng(0)
    right: dict[str, Any] = {
        "patterns": random.random((slots + 1, height, width), np.float32),
        "sequence": np.tile(np.arange(slots), (count, 1)),
        "measurement": random.integers(0, 256, (count, height, width)).astype(np.uint8),
        "scene": random.random(SHAPE, np.float32),
        "aperture": np.ones(count, np.float32),
        "exposure": np.ones(count, np.float32),
        "kind": ["dynamic", "static", "unknown"],
        "attrs": {"format": "sci-captures", "format_version": 1, "bit_depth": 8},
    }
    attrs = {**right["attrs"], **changes.pop("attrs", {})}
    return {**right, **changes, "attrs": {name: value for name, value in attrs.items() if value is not None}}


def write(path: Path, **changes: Any) -> Path:
    """Write ``content(**changes)`` without asking anyone whether it is right."""
    right = content(**changes)
    with h5py.File(path, "w") as file:
        file.attrs.update(right.pop("attrs"))
        for name, values in right.items():
            if values is not None:
                file.create_dataset(name, data=values)
    return path


@pytest.fixture
def file(tmp_path: Path) -> Callable[..., Path]:
    """``file(aperture=None, attrs={"bit_depth": 12})``: a captures file with something changed."""
    return lambda **changes: write(tmp_path / "captures.h5", **changes)
