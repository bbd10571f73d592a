"""Plain words on a command line that stand for settings."""

from __future__ import annotations

import pytest

from sci_lightning.cli.command_line import with_keys


@pytest.mark.parametrize(
    ("words", "written"),
    [
        (["a.h5", "out=b"], ["captures=a.h5", "out=b"]),
        (["out=b", "a.h5"], ["out=b", "captures=a.h5"]),
        (["captures=a.h5"], ["captures=a.h5"]),
        (["lab 1/a,b.h5"], ["captures='lab 1/a,b.h5'"]),
        (["runs/lr=0.1/a.h5"], ["captures='runs/lr=0.1/a.h5'"]),
        (["--cfg", "job", "a.h5"], ["--cfg", "job", "captures=a.h5"]),
        (["a.h5", "b.h5"], ["captures=a.h5", "b.h5"]),  # one too many: refused where settings are checked
        (["+x=1", "~y", "hydra/launcher=joblib"], ["+x=1", "~y", "hydra/launcher=joblib"]),
    ],
)
def test_plain_words_get_their_key(words: list[str], written: list[str]) -> None:
    assert with_keys(words, ["captures"]) == written


def test_in_order() -> None:
    assert with_keys(["a", "b"], ["truth", "report"]) == ["truth=a", "report=b"]
