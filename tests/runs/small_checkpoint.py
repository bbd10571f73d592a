"""A checkpoint of weights as small as one can be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import nn

from sci_lightning.configuration.build import build

CONFIG: dict[str, Any] = {
    "encoder": {
        "_target_": "sci_lightning.encoder.Encoder",
        "mask": {"_target_": "sci_lightning.encoder.mask.RandomBinary", "frames": 4, "size": [8, 8], "seed": 0},
        "sensor": {"_target_": "sci_lightning.encoder.sensor.ClipQuantise", "bit_depth": 8},
        "effects": {},
    },
    "decoder": {"_target_": "sci_lightning.decoder.E2ECNN", "frames": 4, "channels": 4, "blocks": 1},
    "names": {"encoder": "rbw_sr", "decoder": "e2e_cnn"},
    "frames": 4,
    "size": [8, 8],
    "crop": [8, 8],
    "seed": 0,
}


def content() -> dict[str, Any]:
    """What a checkpoint of weights holds."""
    modules = nn.ModuleDict({part: build(CONFIG[part], part) for part in ("encoder", "decoder")})
    return {"config": {**CONFIG}, "state_dict": modules.state_dict()}


def saved(path: Path, **changes: Any) -> Path:
    torch.save({**content(), **changes}, path)
    return path
