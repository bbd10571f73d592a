"""Reading a captures file and checking all of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sci_lightning.captures.captures import SURROUNDS, Captures
from sci_lightning.captures.contents import Contents, Shape
from sci_lightning.captures.kind import KINDS, infer_kinds
from sci_lightning.errors import BadInput
from sci_lightning.files.hdf5_file import open_hdf5
from sci_lightning.files.memory_bound import check_memory
from sci_lightning.homography import check_homography

FORMAT, FORMAT_VERSION = "sci-captures", 2
READABLE = (1, 2)
"""Versions of the format that are read; version 1 has no ``surround``, ``verification``, ``sensor_to_modulator``."""
MOST_CAPTURES = 100_000
"""Largest number of captures in one file; one per second makes 86,400 a day."""


def read_captures(path: str | Path, *, called: str | Path | None = None, registered: bool = True) -> Captures:
    """Read a captures file (HDF5, ``sci-captures`` 1 or 2) and check all of it.

    Defaults for what the file does not state: every capture shows the patterns in their order (T = P), scenes are
    unknown (NaN), aperture and exposure are 1, kinds are inferred from the content, the name is that of the file, and
    what lies beyond the patterns is unknown.

    Args:
        path: the file.
        called: its name in error messages; None for the path.
        registered: whether patterns of another size than the field's are refused as long as nobody has said where they
            lie in it (``sensor_to_modulator``).

    Raises:
        BadInput: missing, unreadable or of another format; a dataset or attribute that is missing, of another type or
            shape, or out of range. One line: the dataset, what it holds, what was expected.
    """
    path = Path(path)
    name = str(called or path)
    if path.is_dir():
        raise BadInput(
            f"{name}: is a folder, expected a captures file (python -m sci_lightning.captures pack makes one)"
        )
    if not path.is_file():
        raise BadInput(f"{name}: no such file")
    with open_hdf5(path, name, "a captures file") as file:
        return _captures(Contents(file, name), path, registered)


def _captures(contents: Contents, path: Path, registered: bool) -> Captures:
    version = _check_format(contents)
    homography = contents.matrix("sensor_to_modulator", (3, 3)) if version > 1 else None
    mirrors = _check_sizes(contents, version, registered and homography is None)
    bits = _number(contents, "bit_depth", "a whole number from 1 to 16", lambda v: 1 <= v <= 16 and v == int(v))
    if bits is None:
        raise contents.refusal("no attribute 'bit_depth', expected a whole number from 1 to 16")
    measurement = _measurement(contents, int(bits))
    count, height, width = measurement.shape
    frame = {"H": height, "W": width}
    with np.errstate(over="ignore"):  # beyond float32 is infinite, and refused as that
        patterns = contents.required_numbers("patterns", "buif", {"P": None, **mirrors}).astype(np.float32)
        _check_range(contents, "'patterns'", patterns, 1)
        sequence = _sequence(contents, count, len(patterns))
        scene = _scene(contents, {"N": count, "T": sequence.shape[1], **frame})
        aperture, exposure = (_scale(contents, name, count) for name in ("aperture", "exposure"))
    kind = contents.strings("kind", {"N": count})
    for index, label in enumerate(kind or ()):
        if label not in KINDS:
            raise contents.refusal(f"'kind' of capture {index} is {label!r}, expected one of {', '.join(KINDS)}")
    if homography is not None and registered:
        try:
            check_homography(homography, (height, width), patterns.shape[1:])
        except BadInput as error:
            raise contents.refusal(str(error)) from error
    title = contents.attribute("name")
    if not isinstance(title, str | None):
        raise contents.refusal(f"attribute 'name' is {title!r}, expected a string")
    return Captures(
        patterns=patterns,
        sequence=sequence,
        measurement=measurement,
        scene=scene,
        aperture=aperture,
        exposure=exposure,
        kind=kind or infer_kinds(patterns, sequence, scene, aperture),
        bit_depth=int(bits),
        read_noise_dn=_number(contents, "read_noise_dn", "0 or more", lambda v: v >= 0),
        full_well_e=_number(contents, "full_well_e", "a positive number", lambda v: v > 0),
        name=title or path.stem,
        path=path,
        surround=_surround(contents) if version > 1 else SURROUNDS[0],
        verification=contents.indices("verification", count) if version > 1 else None,
        sensor_to_modulator=homography,
    )


def _check_format(contents: Contents) -> int:
    """Refuse another format or version, and return the version."""
    for name, readable in (("format", (FORMAT,)), ("format_version", READABLE)):
        content = contents.attribute(name)
        expected = " or ".join(repr(one) for one in readable)
        if content is None:
            raise contents.refusal(f"no attribute '{name}', expected {expected}: not a captures file")
        if content not in readable:
            raise contents.refusal(f"attribute '{name}' is {content!r}, expected {expected}")
    return int(content or 0)


def _surround(contents: Contents) -> str:
    """Return what the file says about the world beyond the patterns."""
    stated = contents.attribute("surround")
    if stated is None:
        return SURROUNDS[0]
    if stated not in SURROUNDS:
        raise contents.refusal(f"attribute 'surround' is {stated!r}, expected {' or '.join(map(repr, SURROUNDS))}")
    return str(stated)


def _number(contents: Contents, name: str, expected: str, is_right: Callable[[float], bool]) -> float | None:
    value = contents.attribute(name)
    if value is None:
        return None
    if isinstance(value, bool | str) or not math.isfinite(value) or not is_right(value):
        raise contents.refusal(f"attribute '{name}' is {value!r}, expected {expected}")
    return float(value)


def _check_sizes(contents: Contents, version: int, one_grid: bool) -> Shape:
    """Check the shape of every dataset, and that all of them fit into memory together, before any is read.

    Args:
        contents: the file.
        version: of its format.
        one_grid: whether the patterns have to be of the field's size.

    Returns:
        the size of the patterns.
    """
    measurement = contents.required_dataset("measurement", {"N": None, "H": None, "W": None})
    count, height, width = measurement.shape
    if count > MOST_CAPTURES:
        raise contents.refusal(f"'measurement' declares {count} captures, expected at most {MOST_CAPTURES}")
    mirrors: Shape = {"H": height, "W": width}
    if version > 1:
        patterns = contents.required_dataset("patterns", {"P": None, "Hm": None, "Wm": None})
        other = patterns.shape[1:] != (height, width)
        if other and one_grid:
            raise contents.refusal(
                f"'patterns' is {patterns.dtype} of shape {patterns.shape}, expected (P, H, W) = "
                f"{(len(patterns), height, width)}, or an attribute 'sensor_to_modulator' that says where they lie in "
                "the field: python -m sci_lightning.captures register finds it"
            )
        mirrors = dict(zip(("Hm", "Wm") if other else ("H", "W"), patterns.shape[1:], strict=True))
    patterns = contents.required_dataset("patterns", {"P": None, **mirrors})
    sequence = contents.dataset("sequence", {"N": count, "T": None})
    slots = len(patterns) if sequence is None else sequence.shape[1]
    contents.dataset("scene", {"N": count, "T": slots, "H": height, "W": width})
    for name in ("aperture", "exposure", "kind"):
        contents.dataset(name, {"N": count})
    pixels = height * width
    declared = measurement.dtype.itemsize * count * pixels + 8 * count * slots
    declared += 4 * (patterns.size + pixels * count * slots)  # the scene is NaN where the file has none
    check_memory(f"{contents.called}: N = {count} captures of {slots} slots, {height} x {width} pixels,", declared)
    return mirrors


def _measurement(contents: Contents, bits: int) -> np.ndarray:
    shape = {"N": None, "H": None, "W": None}
    expected = f"raw DN, integers from 0 to {2**bits - 1} ({bits} bits)"
    item = contents.required_dataset("measurement", shape)
    if item.dtype.kind == "f":
        bad = np.isnan(contents.required_numbers("measurement", "buif", shape)).any((1, 2))
        holds = f"holds NaN (capture {bad.argmax()})" if bad.any() else f"is {item.dtype}"
        raise contents.refusal(f"'measurement' {holds}, expected {expected}")
    values = contents.required_numbers("measurement", "ui", shape)
    for index, capture in enumerate(values):
        worst = capture.min() if capture.min() < 0 else capture.max()
        if not 0 <= worst < 2**bits:
            raise contents.refusal(f"'measurement' of capture {index} holds {worst}, expected {expected}")
    return np.asarray(values, np.uint8 if bits <= 8 else np.uint16)


def _sequence(contents: Contents, count: int, patterns: int) -> np.ndarray:
    values = contents.numbers("sequence", "ui", {"N": count, "T": None})
    if values is None:
        return np.tile(np.arange(patterns, dtype=np.int64), (count, 1))
    wrong = np.argwhere((values < 0) | (values >= patterns))
    if len(wrong):
        capture, slot = wrong[0]
        raise contents.refusal(
            f"'sequence' of capture {capture}, slot {slot} is {values[capture, slot]}, expected 0 to {patterns - 1} "
            f"(there are {patterns} patterns)"
        )
    return np.asarray(values, np.int64)


def _scene(contents: Contents, shape: dict[str, int]) -> np.ndarray:
    values = contents.numbers("scene", "buif", {**shape})
    if values is None:
        return np.full(tuple(shape.values()), np.nan, np.float32)
    scene = np.asarray(values, np.float32)
    for index, capture in enumerate(scene):
        missing = np.isnan(capture)
        if missing.all():
            continue
        if missing.any():
            raise contents.refusal(
                f"'scene' of capture {index} is NaN in {missing.sum()} of {missing.size} values, "
                "expected a scene that is wholly known or wholly NaN"
            )
        _check_range(contents, f"'scene' of capture {index}", capture, math.inf)
    return scene


def _scale(contents: Contents, name: str, count: int) -> np.ndarray:
    values = contents.numbers(name, "buif", {"N": count})
    scale = np.ones(count, np.float32) if values is None else np.asarray(values, np.float32)
    _check_range(contents, f"'{name}'", scale, math.inf)
    return scale


def _check_range(contents: Contents, what: str, values: np.ndarray, high: float) -> None:
    bad = ~(np.isfinite(values) & (values >= 0) & (values <= high))
    if bad.any():
        where = tuple(int(index) for index in np.argwhere(bad)[0])
        expected = "0 to 1 (transmittance)" if high == 1 else "finite and 0 or more"
        place = ", ".join(str(index) for index in where)
        raise contents.refusal(f"{what} holds {values[where]:g} at [{place}], expected {expected}")
