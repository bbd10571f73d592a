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

from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_type_hints

from annotated_types import DocInfo, Interval, Len, MinLen
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, PrivateAttr, ValidationError

from sci_lightning.captures.kind import Kind
from sci_lightning.configuration.annotation import in_words
from sci_lightning.configuration.bounds import NonNegative, Positive
from sci_lightning.errors import BadInput
from sci_lightning.files.yaml_file import read_yaml
from sci_lightning.plain_text import excerpt

FILE = "captures.yaml"
WORDS = ("all_off", "all_on")
LONGEST_TEXT = 200
"""Largest number of characters of a name."""


def _number(value: object) -> object:
    """Return the number that a text is which YAML 1.1 does not take for one (1e4); anything else as it is."""
    if isinstance(value, str):
        with suppress(ValueError):
            value = float(value)
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _short(value: str) -> str:
    if not value.isprintable() or len(value) > LONGEST_TEXT:
        raise ValueError("not printable, or too long")
    return value


Real = Annotated[float, BeforeValidator(_number)]
Text = Annotated[str, AfterValidator(_short), DocInfo(f"at most {LONGEST_TEXT} printable characters")]
Files = Annotated[
    list[Annotated[str, MinLen(1)]],
    BeforeValidator(lambda value: value if isinstance(value, list) else [value]),
    MinLen(1),
    DocInfo("a file, a glob or a list of them"),
]
Matrix = Annotated[list[Annotated[list[Real], Len(3, 3)]], Len(3, 3), DocInfo("three rows of three numbers")]


class Node(BaseModel):
    """A mapping in the file."""

    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)
    _where: str = PrivateAttr("")

    @property
    def where(self) -> str:
        """Its place, with which messages begin."""
        return self._where

    def refusal(self, key: str, text: str) -> BadInput:
        """Return the error that says ``text`` about ``key``."""
        return BadInput(f"{self.where}{key}: {' '.join(text.split())}")


class CaptureEntry(Node):
    """An entry of ``captures``; one may be several captures."""

    measurement: Files
    kind: Kind | None = None
    aperture: Annotated[NonNegative, BeforeValidator(_number)] | None = None
    exposure: Annotated[NonNegative, BeforeValidator(_number)] | None = None
    sequence: Any = None
    scene: Real | Files | None = None
    scene_levels: Annotated[Positive, BeforeValidator(_number)] | None = None
    verification: bool = False


class Top(Node):
    """What holds for all captures."""

    bit_depth: Annotated[int, BeforeValidator(_number), Interval(ge=1, le=16)]
    name: Text | None = None
    read_noise_dn: Annotated[NonNegative, BeforeValidator(_number)] | None = None
    full_well_e: Annotated[Positive, BeforeValidator(_number)] | None = None
    sensor_to_modulator: Matrix | None = None
    surround: Literal["unknown", "dark"] | None = None
    frames: Annotated[int, BeforeValidator(_number), Interval(ge=1, le=100_000)] | None = None
    patterns: Files
    pattern_levels: Annotated[Positive, BeforeValidator(_number)] | None = None
    captures: list[Any]


Part = TypeVar("Part", bound=Node)


@dataclass(frozen=True)
class Recipe:
    """The whole file: its top level and the entries of ``captures``."""

    folder: Path
    top: Top
    entries: tuple[CaptureEntry, ...]


def read_recipe(folder: str | Path) -> Recipe:
    """Read ``captures.yaml`` of a folder; what a file or a sequence means is checked when it is used.

    Raises:
        BadInput: no such folder or file, not YAML, an unknown or missing key, a value of another type or out of range.
    """
    folder = Path(folder)
    path = folder / FILE
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder")
    if not path.is_file():
        raise BadInput(f"{folder}: no {FILE} in this folder; it says what the files are")
    content = read_yaml(path)
    if not isinstance(content, dict):
        kind = "nothing" if content is None else type(content).__name__
        raise BadInput(f"{path}: expected keys and values ({', '.join(Top.model_fields)}), found {kind}")
    top = _node(f"{path}: ", content, Top)
    if not top.captures:
        raise top.refusal("captures", "expected a list of entries, got an empty one")
    entries = []
    for index, entry in enumerate(top.captures):
        if not isinstance(entry, dict):
            raise top.refusal(f"captures[{index}]", f"expected keys and values, got {entry!r}")
        entries.append(_node(f"{path}: captures[{index}].", entry, CaptureEntry))
    return Recipe(folder, top, tuple(entries))


def _node(where: str, content: dict[Any, Any], model: type[Part]) -> Part:
    known = list(model.model_fields)
    for key in content:
        if key not in known:
            near = get_close_matches(str(key), known, 1)
            raise BadInput(
                f"{where}{excerpt(key)}: unknown key; {f'{near[0]}?' if near else 'use ' + ', '.join(known)}"
            )
    for key, field in model.model_fields.items():
        if field.is_required() and content.get(key) is None:
            raise BadInput(f"{where}{key}: is missing")
    try:
        node = model.model_validate(content)
    except ValidationError as error:
        key = str(error.errors()[0]["loc"][0])
        expected = in_words(get_type_hints(model, include_extras=True)[key])
        raise BadInput(f"{where}{key}: expected {expected}, got {excerpt(repr(content[key]), 60)}") from error
    node._where = where
    return node
