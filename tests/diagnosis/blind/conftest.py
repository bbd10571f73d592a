"""Snapshots of the virtual camera, which shares no code with the encoder."""

from __future__ import annotations

from typing import Any

from sci_lightning.captures import Captures
from sci_lightning.virtual_camera import Session, VirtualCamera

NONE = {"dark": 0, "flat": 0, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 0}


def snapshots(
    hidden: dict[str, dict[str, Any]] | None = None, count: int = 3, side: int = 48, seed: int = 5, **session: Any
) -> Captures:
    """Snapshots of unknown scenes behind a random binary mask, and nothing else."""
    plan = {**NONE, "unknown": count, "size": (side, side), "frames": 4, "mask": "binary", "bit_depth": 12, **session}
    return VirtualCamera(Session(**plan), hidden or {}).capture(seed)
