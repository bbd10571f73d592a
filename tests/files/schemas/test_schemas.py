"""Files follow their schemas, those of the version before too, and every field is described."""

from __future__ import annotations

import json
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from sci_lightning.captures import read_captures, recipe, write_captures
from sci_lightning.files.schemas import SCHEMAS, outline, read_schema
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.files.schemas.validation import check, errors


def properties(schema: Any, place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every property of every object that a schema describes, with its place."""
    if isinstance(schema, dict):
        if isinstance(schema.get("properties"), dict):
            yield from ((f"{place}.{name}", inner) for name, inner in schema["properties"].items())
        for key, inner in schema.items():
            yield from properties(inner, f"{place}/{key}")
    elif isinstance(schema, list):
        for inner in schema:
            yield from properties(inner, place)


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_schema_is_valid_and_describes_every_field(name: str) -> None:
    schema = read_schema(name)
    Draft202012Validator.check_schema(schema)
    assert schema["title"] and schema["description"]
    described = [place for place, _ in properties(schema)]
    assert len(described) > 3
    for place, inner in properties(schema):
        assert inner.get("description") or "$ref" in inner, place


def test_an_unknown_schema() -> None:
    with pytest.raises(KeyError, match="no schema 'reports'; there are benchmark, captures_file"):
        read_schema("reports")


def test_what_is_required_and_what_has_no_place(tmp_path: Path) -> None:
    truth = VirtualCamera(Session(size=(16, 16), frames=2), {"prnu": {}}).write(tmp_path / "a.h5", seed=1)
    content = json.loads(truth.read_text())
    check("captures_truth", content)
    for key in read_schema("captures_truth")["required"]:
        less = deepcopy(content)
        del less[key]
        assert errors("captures_truth", less), key
    assert errors("captures_truth", content | {"more": 1}) and errors("captures_truth", content | {"format_version": 2})


def test_captures_files_follow_the_schema(tmp_path: Path) -> None:
    truth = VirtualCamera(Session(size=(16, 16), frames=2), {"prnu": {}}).write(tmp_path / "a.h5", seed=1)
    check("captures_file", outline(tmp_path / "a.h5"))
    check("captures_truth", json.loads(truth.read_text()))
    write_captures(tmp_path / "b.h5", read_captures(tmp_path / "a.h5"))
    content = outline(tmp_path / "b.h5")
    check("captures_file", content)
    assert set(content["datasets"]) == set(read_schema("captures_file")["properties"]["datasets"]["properties"])
    content["datasets"]["measurement"]["dtype"] = "float32"
    assert errors("captures_file", content)


def test_the_truth_describes_every_setting_of_a_session() -> None:
    session = read_schema("captures_truth")["properties"]["session"]["properties"]
    assert set(session) == {field.name for field in fields(Session)}


def test_the_recipe_in_the_documentation_follows_its_schema() -> None:
    text = (recipe.__doc__ or "").split("\n\n")[1]
    content = yaml.safe_load(text)
    check("captures_recipe", content)
    schema = read_schema("captures_recipe")["properties"]
    assert set(schema) == set(recipe.TOP) and set(schema["captures"]["items"]["properties"]) == set(recipe.ENTRY)
    assert errors("captures_recipe", content | {"bit_dept": 8})
