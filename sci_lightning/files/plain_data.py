"""Plain data: all that a configuration out of a file may consist of."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt, with_article

MAX_VALUES = 20_000
"""More values than this is no configuration of a camera or a training. It also ends the walk through nested references
to the same list, which a file of a hundred bytes can unfold into billions of values."""

MAX_DEPTH = 32
MAX_LENGTH = 20_000
"""Of one string, in characters."""


def check_plain_data(path: str | Path, content: Any, references: Mapping[str, str] | None = None) -> None:
    """Check that ``content`` is made of dictionaries, lists, strings, numbers, booleans and None, and nothing else.

    A string with ``${`` would be resolved by OmegaConf, which can read environment variables and build objects. It is
    refused wherever it stands, but for the exact references that the caller names.

    Args:
        path: the file that ``content`` was read from, for messages.
        content: what was read.
        references: the one reference that may stand for a key, by the key: ``{"size": "${size}"}``.

    Raises:
        BadInput: anything else, too many values, or values too deeply nested.
    """
    budget = MAX_VALUES
    waiting: list[tuple[str, Any, int]] = [("", content, 0)]
    while waiting:
        place, value, depth = waiting.pop()
        budget -= 1
        if budget < 0 or depth > MAX_DEPTH:
            raise BadInput(f"{path}: too large for a configuration (over {MAX_VALUES} values or {MAX_DEPTH} levels)")
        if isinstance(value, Mapping):
            for key, entry in value.items():
                if not isinstance(key, str) or not key.isprintable() or len(key) > 200 or "${" in key:
                    raise BadInput(f"{path}: {_at(place)}the key {excerpt(repr(key))} is not plain text")
                if not (references and entry == references.get(key, "")):
                    waiting.append((f"{place}.{key}" if place else key, entry, depth + 1))
        elif isinstance(value, (list, tuple)):
            waiting.extend((f"{place}[{index}]", entry, depth + 1) for index, entry in enumerate(value))
        elif isinstance(value, str):
            if "${" in value:
                raise BadInput(
                    f"{path}: {_at(place)}'{excerpt(value)}' would be resolved, not read; a file holds plain values"
                )
            if len(value) > MAX_LENGTH:
                raise BadInput(f"{path}: {_at(place)}a string of {len(value):,} characters; at most {MAX_LENGTH:,}")
        elif isinstance(value, int) and abs(value) >= 2**63:
            raise BadInput(f"{path}: {_at(place)}a whole number of {value.bit_length()} bits; at most 63")
        elif value is not None and not isinstance(value, (bool, int, float)):
            raise BadInput(f"{path}: {_at(place)}holds {with_article(type(value).__name__)}, expected plain values")


def _at(place: str) -> str:
    return f"{excerpt(place)}: " if place else ""
