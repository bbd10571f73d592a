"""Validation of plain data against the schemas, for tests that make files of our formats anyway."""

from __future__ import annotations

from typing import Any

from jsonschema import Draft202012Validator
from referencing import Registry, Resource

from sci_lightning.files.schemas import SCHEMAS, read_schema

REGISTRY: Registry[Any] = Registry().with_resources(
    (f"{name}.json", Resource.from_contents(read_schema(name))) for name in SCHEMAS
)


def errors(name: str, content: Any) -> list[str]:
    """Return a line for everything in ``content`` that breaks the schema of this name."""
    validator = Draft202012Validator({"$ref": f"{name}.json"}, registry=REGISTRY)
    return [f"{error.json_path}: {error.message}" for error in validator.iter_errors(content)]


def check(name: str, content: Any) -> None:
    """Fail unless ``content`` follows the schema of this name."""
    assert not errors(name, content)
