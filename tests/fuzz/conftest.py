"""A folder of its own for every fuzz test, in which nothing may appear that hostile content asks for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fuzz.hostile import CANARY


@pytest.fixture
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The empty folder that the test works in; nothing was executed when the test ends."""
    monkeypatch.chdir(tmp_path)
    victim = tmp_path / "victim"
    victim.mkdir()
    (victim / "precious").write_text("kept")
    yield tmp_path
    assert not (tmp_path / CANARY).exists()
    assert (victim / "precious").read_text() == "kept"
