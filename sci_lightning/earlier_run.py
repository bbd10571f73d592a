"""What an earlier run of the same configuration left in a folder: all of it, or a part to go on from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sci_lightning.checkpoint import read_checkpoint
from sci_lightning.errors import BadInput

FREE = {"out", "debug", "resume", "ckpt_path", "names", "workers", "callbacks", "logger"}
"""Entries of a configuration that do not change what a run finds."""


def finished(out: Path, config: Mapping[str, Any]) -> dict[str, Any] | None:
    """The content of ``metrics.json`` in ``out``, None if there is none.

    Raises:
        BadInput: it is damaged, or of another configuration.
    """
    path = out / "metrics.json"
    if not path.is_file():
        return None
    try:
        found = json.loads(path.read_text())
        earlier = found["config"]
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path}: not the metrics of a run; remove it, and the run is made again") from error
    _check_same(path, earlier, config)
    return dict(found)


def interrupted(out: Path, config: Mapping[str, Any]) -> str | None:
    """The checkpoint in ``out`` that a run can go on from, None if there is none.

    Raises:
        BadInput: it is damaged, or of another configuration.
    """
    path = out / "checkpoints" / "last.ckpt"
    if not path.is_file():
        return None
    _check_same(path, read_checkpoint(path).config, config)
    return str(path)


def _check_same(path: Path, earlier: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    one, other = _comparable(earlier), _comparable(config)
    for key in sorted(one.keys() | other.keys()):
        if one.get(key) != other.get(key):
            told, wanted = (str(each.get(key, "absent")) for each in (one, other))
            raise BadInput(
                f"{path}: of another configuration ({key} is {told}, now {wanted}); give another out=, or remove it"
            )


def _comparable(config: Mapping[str, Any]) -> dict[str, Any]:
    """What a run finds depends on, flat, wherever the run's folder is."""
    parts = json.loads(json.dumps(config).replace(json.dumps(config.get("out", "OUT"))[1:-1], "OUT"))
    return dict(_flat({key: value for key, value in parts.items() if key not in FREE}))


def _flat(content: Mapping[str, Any], above: str = "") -> list[tuple[str, Any]]:
    flat = []
    for key, value in content.items():
        name = f"{above}{key}"
        flat += _flat(value, f"{name}.") if isinstance(value, dict) and value else [(name, value)]
    return flat
