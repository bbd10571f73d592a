"""A study for tests: cases that are numbers, and what one of them computes, in whatever process."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sci_lightning.studies.engine.records import CaseRecord, Records, digest_of


class Square(CaseRecord):
    """The record of a case."""

    format: Literal["sci-square"]
    format_version: Literal[1]
    number: int
    square: int
    process: int


@dataclass(frozen=True)
class Number:
    """A case."""

    number: int
    settings: str = "usual"

    @property
    def name(self) -> str:
        return f"number_{self.number:05d}"

    @property
    def digest(self) -> str:
        return digest_of({"number": self.number, "settings": self.settings})

    def describe(self) -> dict[str, Any]:
        return {"format": "sci-square", "format_version": 1, "number": self.number, "digest": self.digest}


def square(case: Number) -> dict[str, Any]:
    """Return the square; case 13 raises an exception, and the process of case 99 dies."""
    if case.number == 13:
        raise ValueError("an unlucky number")
    if case.number == 99:
        os._exit(3)
    return {"square": case.number**2, "process": os.getpid()}


def slow_square(case: Number) -> dict[str, Any]:
    """The same, in half a second."""
    time.sleep(0.5)
    return square(case)


def records(folder: Path) -> Records[Square]:
    return Records(folder / "cases", Square)
