"""``captures.yaml``: what the files of a folder are.

    bit_depth: 12                  # of the camera, 1 to 16
    name: lab camera               # optional, as are the next four
    read_noise_dn: 2.1             # datasheet: standard deviation, DN
    full_well_e: 10500             # datasheet: electrons at full scale
    sensor_to_modulator: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]   # of patterns on the modulator's own grid: homography from
                                   # a pixel's (x, y, 1) to a mirror's (u, v, 1); `captures register` finds it
    surround: dark                 # what lies beyond the patterns: dark (no light), else unknown
    frames: 8                      # T, slots per capture; else that of the first listed sequence, else the number of
                                   # coding patterns
    patterns: [masks.mat, all_off, all_on]   # files (stacks count for several), globs and these two words
    pattern_levels: 255            # the value of an integer file that means 1.0; else the largest of its type
    captures:
      - measurement: dark/*.tif    # raw DN; a stack or a glob gives several captures
        kind: dark                 # optional label; a dark capture without a scene has the scene 0
        exposure: 2                # integration time relative to nominal, else 1: for dark signal; light that a longer
                                   # exposure gathers is part of the aperture
        sequence: all_off          # one pattern in every slot, or [0, 1, all_off, ..] of T; else 0 to T-1
      - measurement: grey.png
        scene: 0.5                 # an even scene
        aperture: 0.25             # light scale, else 1
        verification: true         # a diagnosis fits nothing to them and is judged by them; else it chooses some
      - measurement: still.tif
        scene: target.png          # (H, W) at rest, or (T, H, W)
        scene_levels: 4095         # as pattern_levels; without a scene: it is unknown

Files are named relative to the folder; a glob is taken in natural order (frame2 before frame10).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.captures.kind import KINDS
from sci_lightning.errors import BadInput
from sci_lightning.files.yaml_file import read_yaml
from sci_lightning.plain_text import excerpt

FILE = "captures.yaml"
WORDS = ("all_off", "all_on")
LONGEST_TEXT = 200
"""Largest number of characters of a name."""

TOP = (
    "bit_depth",
    "name",
    "read_noise_dn",
    "full_well_e",
    "sensor_to_modulator",
    "surround",
    "frames",
    "patterns",
    "pattern_levels",
    "captures",
)
ENTRY = ("measurement", "kind", "aperture", "exposure", "sequence", "scene", "scene_levels", "verification")


@dataclass(frozen=True)
class Node:
    """A mapping in the file.

    Attributes:
        where: its place, with which messages begin.
        values: what the file says, unchecked.
    """

    where: str
    values: dict[str, Any]

    def refusal(self, key: str, text: str) -> BadInput:
        """Return the error that says ``text`` about ``key``."""
        return BadInput(f"{self.where}{key}: {' '.join(text.split())}")

    def number(self, key: str, *, low: float, high: float = math.inf, above: bool = False) -> float | None:
        """Return a number from ``low`` (or above it) to ``high``, None where the key is absent."""
        value = self.values.get(key)
        if value is None:
            return None
        number = as_number(value)
        if number is None or not low <= number <= high or (above and number == low) or math.isinf(number):
            expected = f"a number from {low:g} to {high:g}" if high < math.inf else f"a number of {low:g} or more"
            raise self.refusal(key, f"expected {'a positive number' if above else expected}, got {value!r}")
        return number

    def whole(self, key: str, *, low: int, high: int) -> int | None:
        """Return a whole number from ``low`` to ``high``, None where the key is absent."""
        number = self.number(key, low=low, high=high)
        if number is not None and number != int(number):
            raise self.refusal(key, f"expected a whole number from {low} to {high}, got {number:g}")
        return None if number is None else int(number)

    def text(self, key: str, choices: tuple[str, ...] = ()) -> str | None:
        """Return a string, one of ``choices`` if any are given; None where the key is absent."""
        value = self.values.get(key)
        if value is not None and (not isinstance(value, str) or (choices and value not in choices)):
            raise self.refusal(
                key, f"expected {'one of ' + ', '.join(choices) if choices else 'a text'}, got {value!r}"
            )
        if value is not None and (not value.isprintable() or len(value) > LONGEST_TEXT):
            raise self.refusal(key, f"expected at most {LONGEST_TEXT} printable characters, got {excerpt(value, 60)}")
        return value

    def flag(self, key: str) -> bool:
        """Return true or false, false where the key is absent."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            raise self.refusal(key, f"expected true or false, got {value!r}")
        return value

    def matrix(self, key: str) -> np.ndarray | None:
        """Return 3 x 3 numbers as float64, None where the key is absent."""
        value = self.values.get(key)
        if value is None:
            return None
        rows = value if isinstance(value, list) else []
        numbers = [[as_number(entry) for entry in row] if isinstance(row, list) else [] for row in rows]
        if len(numbers) != 3 or any(len(row) != 3 or None in row for row in numbers):
            raise self.refusal(key, f"expected three rows of three numbers, got {excerpt(value, 60)}")
        return np.array(numbers, np.float64)

    def files(self, key: str) -> list[str]:
        """Return one or more file names or globs."""
        value = self.values.get(key)
        listed = value if isinstance(value, list) else [value]
        names = [name for name in listed if isinstance(name, str) and name]
        if not names or len(names) < len(listed):
            raise self.refusal(key, f"expected a file, a glob or a list of them, got {value!r}")
        return names


@dataclass(frozen=True)
class Recipe:
    """The whole file: its top level and the entries of ``captures``."""

    folder: Path
    top: Node
    entries: tuple[Node, ...]


def read_recipe(folder: str | Path) -> Recipe:
    """Read ``captures.yaml`` of a folder; keys are checked here, values when they are used.

    Raises:
        BadInput: no such folder or file, not YAML, an unknown or missing key.
    """
    folder = Path(folder)
    path = folder / FILE
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder")
    if not path.is_file():
        raise BadInput(f"{folder}: no {FILE} in this folder; it says what the files are")
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise BadInput(f"{path}: expected keys and values ({', '.join(TOP)}), found {_called(content)}")
    top = _node(f"{path}: ", content, TOP, ("bit_depth", "patterns", "captures"))
    listed = top.values["captures"]
    if not isinstance(listed, list) or not listed:
        raise top.refusal("captures", f"expected a list of entries, got {_called(listed)}")
    entries = []
    for index, entry in enumerate(listed):
        if not isinstance(entry, dict):
            raise top.refusal(f"captures[{index}]", f"expected keys and values, got {entry!r}")
        entries.append(_node(f"{path}: captures[{index}].", entry, ENTRY, ("measurement",)))
    for node in entries:
        node.text("kind", KINDS)
    return Recipe(folder, top, tuple(entries))


def as_number(value: object) -> float | None:
    """Return a number, also one that YAML 1.1 takes for text (1e4); None for anything else and for NaN."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return None if math.isnan(number) else number


def _called(value: object) -> str:
    return "nothing" if value is None else type(value).__name__


def _node(where: str, content: dict[Any, Any], known: tuple[str, ...], needed: tuple[str, ...]) -> Node:
    node = Node(where, content)
    for key in content:
        if key not in known:
            near = get_close_matches(str(key), known, 1)
            raise node.refusal(str(key), f"unknown key; {f'{near[0]}?' if near else 'use ' + ', '.join(known)}")
    for key in needed:
        if content.get(key) is None:
            raise node.refusal(key, "is missing")
    return node
