"""JSON formats: a pydantic model each, which says what is written, checks what is read, and yields the JSON Schema.

print(json.dumps(DiagnosisReport.model_json_schema(), indent=1))
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import from_json

from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.bounded_file import read_bounded
from sci_lightning.plain_text import excerpt

LARGEST_FILE = 8 * 2**20
"""Bytes of a JSON file that are read; the metrics of a thousand scenes take a tenth of it."""
MOST_VALUES = 100_000
"""Commas and opening brackets of a JSON file that is read: pydantic keeps a copy of whatever it finds wrong, for every
entry that is missing in it."""
LONGEST_TEXT = 200
"""Characters of names and of what a message says about one entry."""

FORMAT = ("format", "format_version")

Number = int | float
"""A number that is written as it was given: 20 or 20.0."""


def says(text: str, **bounds: Any) -> Any:
    """Return the field of a model that ``text`` describes; ``bounds`` as of :func:`pydantic.Field`."""
    return Field(description=text, **bounds)


class JsonObject(BaseModel):
    """An object within a file. It has the keys of its class and no others; what does not apply is absent."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def as_json(self) -> dict[str, Any]:
        """Return what the file holds: the keys that were given, in the order of the class."""
        return self.model_dump(exclude_unset=True, by_alias=True)


class JsonFile(JsonObject):
    """A whole file; a subclass says which ``format`` and ``format_version`` it has."""

    format: str
    format_version: int

    def as_json(self) -> dict[str, Any]:
        """Return what the file holds, the name of its format first."""
        return {"format": self.format, "format_version": self.format_version, **super().as_json()}


File = TypeVar("File", bound=JsonObject)
Model = TypeVar("Model", bound=BaseModel)


def read_json(path: str | Path, model: type[File], largest: int = LARGEST_FILE) -> File:
    """Read a JSON file that anybody may have written.

    Args:
        path: of the file.
        model: of its format; a file without a name of its format is a plain :class:`JsonObject`.
        largest: bytes that are read at most.

    Raises:
        BadInput: no regular file, larger, no JSON, another format, or an entry that is missing, unknown, of another
            type or out of its bounds; the message names it.
    """
    raw = read_bounded(Path(path), largest, "no file that a run leaves")
    if sum(map(raw.count, (b",", b"[", b"{"))) > MOST_VALUES:
        raise BadInput(f"{path}: more than {MOST_VALUES:,} values, which no file that a run leaves has")
    expected = format_name(model) if issubclass(model, JsonFile) else "an object"
    try:
        content = from_json(raw)
    except ValueError as error:
        raise BadInput(f"{path}: not readable as JSON ({excerpt(error)}); expected {expected}") from error
    named = not issubclass(model, JsonFile) or (
        isinstance(content, dict) and all(content.get(key) in allowed(model, key) for key in FORMAT)
    )
    if not named:
        raise BadInput(f"{path}: of another format, expected {expected}")
    try:
        return model.model_validate_json(raw, strict=True)
    except ValidationError as error:
        raise BadInput(f"{path}: {_reason(error)}") from error


def check_part(path: str | Path, place: str, content: object, model: type[Model]) -> Model:
    """Check an entry of a file that was read, a configuration for instance, by a model of its own.

    Raises:
        BadInput: as :func:`read_json`; ``place`` is where the entry stands.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise BadInput(f"{path}: {_reason(error, place)}") from error


def write_json(content: Mapping[str, Any], path: str | Path, among_many: bool = False) -> None:
    """Write JSON whole or not at all; ``among_many`` as of :func:`~sci_lightning.files.atomic_file.atomic_write`."""
    with atomic_write(path, among_many) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")


def format_name(model: type[JsonFile]) -> str:
    """Return a format with its versions in words, as in ``format sci-diagnosis 1 or 2``."""
    return f"format {allowed(model, 'format')[0]} {' or '.join(map(str, allowed(model, 'format_version')))}"


def allowed(model: type[JsonFile], key: str) -> tuple[Any, ...]:
    """Return what ``format`` or ``format_version`` may be in a file."""
    return get_args(model.model_fields[key].annotation)


def _reason(error: ValidationError, above: str = "") -> str:
    """Say in one line which entry of a file is wrong, and what would be right."""
    first = error.errors(include_url=False)[0]
    place = excerpt(".".join(map(str, (above, *first["loc"]) if above else first["loc"])), LONGEST_TEXT // 2)
    if first["type"] == "missing":
        return f"{place} is missing"
    expected = excerpt(first["msg"].removeprefix("Value error, "))
    value = first["input"]  # shown only where it is short: it may be anything, of any length
    shown = f", found {value!r}" if isinstance(value, (bool, int, float)) and abs(value) < 1e30 else ""
    return f"{place}: {expected[:1].lower()}{expected[1:]}{shown}"
