"""Configurations out of files are plain data of bounded size; nothing in them is resolved."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.files.plain_data import check_plain_data
from sci_lightning.files.yaml_file import read_yaml


def nested(depth: int) -> list[Any]:
    return [nested(depth - 1)] if depth else []


def doubled(times: int) -> list[Any]:
    """A list of 2**times values in the memory of ``times`` lists."""
    content: list[Any] = [0]
    for _ in range(times):
        content = [content, content]
    return content


def test_plain_data() -> None:
    check_plain_data("a.ckpt", {"a": [1, 2.0, "x", None, True, (3,)], "size": "${size}"}, {"size": "${size}"})


@pytest.mark.parametrize(
    "content",
    [
        {"a": "${oc.env:SECRET}"},
        {"a": ["x", {"b": "${size}"}]},
        {"size": "${size} "},
        {"frames": "${size}"},
        {"size": "${oc.env:${size}}"},
        {"a": "\\${size}"},
        {"${x}": 1},
        {3: 1},
        {"a\n": 1},
        {"a": object()},
        {"a": {1, 2}},
        {"a": b"bytes"},
        {"a": 10**30},
        {"a": "x" * 30_000},
        nested(40),
        doubled(60),
        list(range(30_000)),
    ],
)
def test_what_is_not(content: Any) -> None:
    with pytest.raises(BadInput, match=r"^a\.ckpt: ") as caught:
        check_plain_data("a.ckpt", content, {"size": "${size}"})
    assert str(caught.value).isprintable() and len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: &x [1]\nb: *x\n", "aliases"),
        ("a: &a [x]\n" + "\n".join(f"a{i}: &a{i} [*a,*a,*a,*a,*a,*a]" for i in range(9)), "aliases"),
        ("a: 1\na: 2\n", "stands twice"),
        ("a: !!python/object/apply:os.system ['touch executed']\n", "could not determine a constructor"),
        ("a: [1, {", "not a readable"),
        ("\x00", "not a readable"),
        ("[" * 5000, "not a readable"),
        ("a: " + "x" * 2_000_000, "larger than"),
        (b"\xff\xfe\xff".decode("latin1"), "not a readable|not an encoder|^$"),
    ],
    ids=["alias", "bomb", "twice", "tag", "cut", "null", "deep", "large", "binary"],
)
def test_yaml_that_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "encoder.yaml"
    path.write_bytes(text.encode("latin1"))
    with pytest.raises(BadInput) as caught:
        read_yaml(path)
    assert re.search(reason, str(caught.value)) and len(str(caught.value)) < 500
    assert not (tmp_path / "executed").exists()


def test_yaml_numbers(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("a: 1e-3\nb: 1.0e-3\nc: -2\nd: 1e5\ne: e5\nf: 3e8_camera.tif\ng: 12e4ab\n")
    assert read_yaml(tmp_path / "a.yaml") == {
        "a": 0.001,
        "b": 0.001,
        "c": -2,
        "d": 1e5,
        "e": "e5",
        "f": "3e8_camera.tif",
        "g": "12e4ab",
    }


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.yaml")
    with pytest.raises(BadInput, match="not a readable file"):
        read_yaml(tmp_path / "a.yaml")
