"""Typed, bounded access to a JSON file that anybody may have written."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.files.bounded_file import read_bounded
from sci_lightning.plain_text import printable

LARGEST_FILE = 8 * 2**20
"""Bytes of a JSON file that are read; the metrics of a thousand scenes take a tenth of it."""
LONGEST_TEXT = 200
MOST_ENTRIES = 20_000


@dataclass(frozen=True)
class Fields:
    """A JSON object whose entries are checked when they are asked for.

    Every method raises :class:`~sci_lightning.errors.BadInput` that names the file and the entry where an entry is
    missing (and has no default), of another type, or out of bounds.

    Attributes:
        path: of the file.
        content: the object.
        place: where in the file it lies, such as ``config.encoder.``.
    """

    path: Path
    content: dict[str, object]
    place: str = ""

    def __contains__(self, key: str) -> bool:
        return self.content.get(key) is not None

    def text(self, key: str, default: str | None = None, longest: int = LONGEST_TEXT) -> str:
        """A text of at most ``longest`` characters, with control characters written out."""
        value = self._entry(key, default)
        if not isinstance(value, str) or len(value) > longest:
            raise self._bad(key, value, f"a text of at most {longest} characters")
        return printable(value).replace("\n", " ")

    def number(self, key: str, low: float, high: float) -> float:
        """A finite number from ``low`` to ``high``."""
        value = self._entry(key, None)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise self._bad(key, value, f"a number from {low:g} to {high:g}")
        return float(value)

    def whole(self, key: str, low: int, high: int, default: int | None = None) -> int:
        """A whole number from ``low`` to ``high``."""
        value = self._entry(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self._bad(key, value, f"a whole number from {low:g} to {high:g}")
        return value

    def part(self, key: str, optional: bool = False) -> Fields:
        """An object; an empty one where it is ``optional`` and absent or null."""
        value = self._entry(key, {} if optional else None)
        if not isinstance(value, dict) or len(value) > MOST_ENTRIES:
            raise self._bad(key, value, "an object")
        return Fields(self.path, value, f"{self.place}{key}.")

    def size(self, key: str) -> tuple[int, int]:
        """Height and width in pixels."""
        value = self._entry(key, None)
        sides = value if isinstance(value, list) else []
        if len(sides) != 2 or not all(type(side) is int and 1 <= side <= 100_000 for side in sides):
            raise self._bad(key, value, "height and width in pixels")
        return sides[0], sides[1]

    def names(self) -> tuple[str, ...]:
        """The keys, printable texts of at most ``LONGEST_TEXT`` characters."""
        if not all(key.isprintable() and len(key) <= LONGEST_TEXT for key in self.content):
            raise BadInput(
                f"{self.path}: {self.place.rstrip('.')} has a name that is not printable or longer than {LONGEST_TEXT}"
            )
        return tuple(self.content)

    def _entry(self, key: str, default: object) -> object:
        value = self.content.get(key)
        return default if value is None else value

    def _bad(self, key: str, value: object, expected: str) -> BadInput:
        # the value itself is shown only where it is short: it may be anything, of any length
        shown = f"is {value!r}" if isinstance(value, (int, float)) and abs(value) < 1e30 else f"is {_kind(value)}"
        entry = f"{self.place}{key}".rstrip(".")
        return BadInput(f"{self.path}: {entry} {'is missing' if value is None else shown}, expected {expected}")


def read_json(path: str | Path, largest: int = LARGEST_FILE) -> Fields:
    """Read a JSON file that holds an object, without following what it says.

    Raises:
        BadInput: no regular file, larger than ``largest`` bytes, no UTF-8, no JSON, nested too deeply, a key that
            stands twice in one object, a number that is not finite, or no object.
    """
    path = Path(path)
    raw = read_bounded(path, largest, "no file that a run leaves")
    try:
        content = json.loads(raw.decode("utf-8"), object_pairs_hook=_once, parse_constant=_finite, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else printable(str(error))[:LONGEST_TEXT]
        raise BadInput(f"{path}: not readable as JSON ({reason}); run it again, or leave it out") from error
    if not isinstance(content, dict):
        raise BadInput(f"{path}: holds {_kind(content)}, expected format sci-metrics 1, an object")
    return Fields(path, content)


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    content = dict(pairs)
    if len(content) < len(pairs):
        raise ValueError("a key stands twice in one object")
    return content


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is not a finite number")
    return number


def _kind(value: object) -> str:
    kinds = {dict: "an object", list: "a list", str: "a text", bool: "true or false", int: "a huge number"}
    return kinds.get(type(value), "a number")
