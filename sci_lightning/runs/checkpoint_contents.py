"""What a checkpoint may hold: checked on reading, before anything is made of it."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import torch
from annotated_types import Interval

from sci_lightning.configuration.arguments import check_value
from sci_lightning.configuration.bounds import Frames, Size
from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import check_field, check_fields
from sci_lightning.files.plain_data import check_plain_data
from sci_lightning.plain_text import excerpt
from sci_lightning.runs.checkpoint_archive import check_tensor

REQUIRED: Mapping[str, Any] = {
    "encoder": Mapping[str, Any],
    "decoder": Mapping[str, Any],
    "names": Mapping[str, str],
    "frames": Frames,
    "size": Size,
    "crop": Size,
    "seed": Annotated[int, Interval(ge=0, lt=2**63)],
}
"""The keys of a run's configuration that anything is read from, and their types."""

NAME = re.compile(r"[\w.+ -]{1,100}")
"""What an encoder or a decoder may be called: a name becomes part of messages, titles and file names."""


def check_run_config(path: Path, config: Mapping[str, Any]) -> None:
    """Check the configuration in a checkpoint: plain data, every key that is read there and of its type.

    Raises:
        BadInput: it is not; the message says which key, what it holds and what was expected.
    """
    check_plain_data(path, config)
    for key, kind in REQUIRED.items():
        if key not in config:
            raise BadInput(f"{path}: its configuration has no '{key}'; not a checkpoint of this version, or damaged")
        try:
            check_value(key, config[key], kind)
        except BadInput as error:
            raise BadInput(f"{path}: {error}") from error
    for part in ("encoder", "decoder"):
        name = config["names"].get(part)
        if name is None or not NAME.fullmatch(name):
            raise BadInput(f"{path}: names.{part}={excerpt(name)}: expected the name of the {part}")
    check_field(config["frames"], config["size"], f"{path}: ")
    check_fields(config["encoder"], f"{path}: ")


def check_state(path: Path, state: Mapping[Any, Any]) -> None:
    """Check that a state holds ordinary tensors by name.

    Raises:
        BadInput: it does not.
    """
    for name, tensor in state.items():
        if not isinstance(name, str) or not isinstance(tensor, torch.Tensor):
            kind = type(tensor).__name__
            raise BadInput(f"{path}: its state holds {excerpt(name)} of type {kind}, expected tensors by name")
        if not name.isprintable():
            raise BadInput(f"{path}: its state holds the name {excerpt(name)}, expected printable names")
        check_tensor(path, name, tensor)


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
