"""A digest over what a checkpoint means: configuration and weights, whatever the file around them looks like."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import torch


def checkpoint_digest(config: Mapping[str, Any], state: Mapping[str, torch.Tensor]) -> str:
    """Return the SHA-256 of a configuration and of a state's names, types, shapes and values.

    It tells a damaged file from a whole one. It is no signature: who changes a file on purpose can change it as well.

    Args:
        config: plain data.
        state: tensors by name, on any device.
    """
    digest = hashlib.sha256(json.dumps(config, sort_keys=True, default=str).encode())
    for name in sorted(state):
        tensor = state[name].detach().cpu().contiguous()
        digest.update(f"\0{name}\0{tensor.dtype}\0{tuple(tensor.shape)}\0".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()
