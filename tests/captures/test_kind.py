"""The kind that the content shows is the kind that the virtual camera's label says."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from sci_lightning.captures import KINDS, infer_kind, read_captures
from sci_lightning.virtual_camera import Session, VirtualCamera

SIZE = (4, 5)
ROWS = np.eye(4)[:, :, None] * np.ones(5)
"""Coding pattern p lets light through in row p only."""
PATTERNS = np.concatenate([ROWS, np.zeros((1, *SIZE)), np.ones((1, *SIZE))])
OFF, ON = 4, 5
TEXTURE = np.random.default_rng(0).random(SIZE)
MOVING = np.stack([np.roll(TEXTURE, slot, 1) for slot in range(4)])


@pytest.mark.parametrize("mask", ["structural", "binary"])
@pytest.mark.parametrize("labelled", [True, False])
def test_virtual_camera(tmp_path, mask, labelled):
    session = Session(size=(16, 20), frames=4, mask=mask, unknown=2, pattern=6)
    taken = VirtualCamera(session, "random").simulate(2)
    path = tmp_path / "a.h5"
    taken.write(path)
    if not labelled:
        with h5py.File(path, "a") as file:
            del file["kind"]
    captures = read_captures(path)
    assert captures.kind == captures.inferred_kind == taken.acquisition.kind
    assert set(captures.kind) == set(KINDS)


@pytest.mark.parametrize(
    ("kind", "sequence", "scene", "aperture"),
    [
        ("dark", [0, 1, 2, 3], 0, 1),
        ("dark", [0, 1, 2, 3], 0.5, 0),
        ("dark", [0, 1, 2, 3], np.nan, 0),
        ("dark", [0, 0, 1, 1], 0.5 * ROWS[3], 1),  # light where no pattern lets it through
        ("flat", [0, 1, 2, 3], 0.5, 0.1),
        ("flat", [ON] * 4, 0.5, 0.25),
        ("pattern", [OFF] * 4, 0.5, 1),
        ("pattern", [OFF, 1, OFF, OFF], 0.5, 1),
        ("pattern", [OFF, OFF, ON, OFF], MOVING, 1),
        ("static", [0, 1, 2, 3], TEXTURE, 1),
        ("dynamic", [0, 1, 2, 3], MOVING, 1),
        ("dynamic", [ON] * 4, np.arange(1, 5)[:, None, None] / 5, 1),  # even, but not for long
        ("unknown", [0, 1, 2, 3], np.nan, 1),
        ("unknown", [OFF, 1, OFF, OFF], np.nan, 1),
    ],
)
def test_kind(kind, sequence, scene, aperture):
    scene = np.broadcast_to(scene, (4, *SIZE))
    assert infer_kind(PATTERNS, np.array(sequence), scene.astype(np.float32), aperture) == kind


def test_one_slot_is_no_single_pattern() -> None:
    scene = TEXTURE[None].astype(np.float32)
    assert infer_kind(PATTERNS, np.array([ON]), scene) == "static"
