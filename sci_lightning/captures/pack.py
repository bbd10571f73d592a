"""Packing a folder of pictures and its ``captures.yaml`` into one captures file."""

from __future__ import annotations

import glob
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sci_lightning.captures.captures import SURROUNDS, Captures
from sci_lightning.captures.kind import infer_kind
from sci_lightning.captures.plausibility import Entry, check_entries, suspicions
from sci_lightning.captures.recipe import FILE, WORDS, CaptureEntry, Node, Recipe, read_recipe
from sci_lightning.captures.write import write_captures
from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import check_memory
from sci_lightning.files.picture_file import COPIES, natural, read_stack
from sci_lightning.homography import check_homography, nearest_mirrors

MOST_SLOTS = 5_000_000
"""Largest number of slots of all entries together; every one of them is checked."""


def pack_captures(
    folder: str | Path, out: str | Path, *, on_warning: Callable[[str], object] = warnings.warn
) -> Captures:
    """Pack the TIFF, PNG, MAT and NPY files that a folder's ``captures.yaml`` names.

    The keys of that file are described in :mod:`sci_lightning.captures.recipe`.

    Args:
        folder: holds ``captures.yaml``.
        out: the captures file, .h5 or .hdf5; it is written whole or not at all.
        on_warning: called with one line for everything that is unlikely, see
            :func:`~sci_lightning.captures.plausibility.suspicions`.

    Returns:
        The captures as read back from the file.

    Raises:
        BadInput: a key or a file that cannot be used, or that contradicts the others; the message names the key.
        MachineFailure: the disk is full.
    """
    return write_captures(out, assemble_captures(folder, on_warning=on_warning))


def assemble_captures(
    folder: str | Path, *, on_warning: Callable[[str], object] = warnings.warn, registered: bool = True
) -> Captures:
    """Read the captures of a folder as :func:`pack_captures` does, without writing them.

    Args:
        folder: holds ``captures.yaml``.
        on_warning: called with one line for everything that is unlikely.
        registered: whether patterns of another size than the field's are refused as long as nobody has said where they
            lie in it. As long as nobody has, nothing is compared with what they predict.

    Raises:
        BadInput: see :func:`pack_captures`.
    """
    recipe = read_recipe(folder)
    bit_depth = recipe.top.bit_depth
    patterns, words, level = _patterns(recipe)
    frames = _frames(recipe, len(patterns) - len(words))
    check_memory(f"{recipe.top.where}{len(recipe.entries)} entries of {frames} slots", 8 * len(recipe.entries) * frames)
    if len(recipe.entries) * frames > MOST_SLOTS:
        raise BadInput(
            f"{recipe.top.where}{len(recipe.entries)} entries of {frames} slots, expected at most {MOST_SLOTS:,} slots "
            "in all; several captures can be one entry"
        )
    stated = recipe.top.sensor_to_modulator
    homography = None if stated is None else np.array(stated, np.float64)
    size = patterns.shape[1:] if homography is None and registered else None
    packed: list[Entry] = []
    for node in recipe.entries:
        of_patterns = homography is None and registered
        measurement = _measurement(recipe.folder, node, bit_depth, size, "the patterns" if of_patterns else "the first")
        size = (measurement.shape[1], measurement.shape[2])
        packed.append(_pack(recipe.folder, node, measurement, patterns, words, frames))
        taken = sum(entry.measurement.nbytes for entry in packed)
        check_memory(f"{node.where}all measurements so far", COPIES * taken)
    check_entries(packed)
    field = packed[0].measurement.shape[1:]
    seen = _in_field(recipe, patterns, homography, field) if registered or homography is None else None
    if seen is not None:
        for line in suspicions(recipe.top, packed, seen, len(patterns) - len(words), bit_depth, level):
            on_warning(line)
    repeats = [len(entry.measurement) for entry in packed]
    check_memory(
        f"{recipe.top.where}{sum(repeats)} captures of {frames} slots", 4 * sum(repeats) * packed[0].scene.size
    )
    return Captures(
        patterns=patterns,
        sequence=np.repeat([entry.sequence for entry in packed], repeats, 0),
        measurement=np.concatenate([entry.measurement for entry in packed]),
        scene=np.repeat(np.stack([entry.scene for entry in packed]), repeats, 0),
        aperture=np.repeat(np.array([entry.aperture for entry in packed], np.float32), repeats),
        exposure=np.repeat(np.array([entry.exposure for entry in packed], np.float32), repeats),
        kind=tuple(entry.kind for entry in packed for _ in entry.measurement),
        bit_depth=bit_depth,
        read_noise_dn=recipe.top.read_noise_dn,
        full_well_e=recipe.top.full_well_e,
        verification=_verification(packed),
        surround=recipe.top.surround or SURROUNDS[0],
        name=recipe.top.name or Path(folder).resolve().name,
        sensor_to_modulator=homography,
    )


def _in_field(
    recipe: Recipe, patterns: np.ndarray, homography: np.ndarray | None, field: tuple[int, ...]
) -> np.ndarray | None:
    """Return the patterns as the pixels of a field see them, (P, H, W); None where nobody has said where they lie."""
    if homography is None:
        return patterns if patterns.shape[1:] == field else None
    size, mirrors = (field[0], field[1]), (patterns.shape[1], patterns.shape[2])
    try:
        check_homography(homography, size, mirrors)
    except BadInput as error:
        raise BadInput(f"{recipe.top.where}{error}") from error
    return nearest_mirrors(patterns, homography, size)


def _verification(packed: list[Entry]) -> tuple[int, ...] | None:
    """Return the numbers of the captures that are set aside to verify a diagnosis; None if none are."""
    aside = [entry.node.verification for entry in packed for _ in entry.measurement]
    return tuple(number for number, is_aside in enumerate(aside) if is_aside) if any(aside) else None


def _pack(
    folder: Path, entry: CaptureEntry, measurement: np.ndarray, patterns: np.ndarray, words: dict[str, int], frames: int
) -> Entry:
    sequence = _sequence(entry, len(patterns), words, frames)
    scene = _scene(folder, entry, (frames, *measurement.shape[1:]))
    aperture, exposure = (1.0 if value is None else value for value in (entry.aperture, entry.exposure))
    kind = entry.kind or infer_kind(patterns, sequence, scene, aperture)
    return Entry(entry, measurement, sequence, scene, aperture, exposure, kind)


def _patterns(recipe: Recipe) -> tuple[np.ndarray, dict[str, int], float | None]:
    """Return the patterns (P, H, W) in [0, 1], the indices of all_off and all_on if listed, and the value for 1.0."""
    names = recipe.top.patterns
    words = [name for name in names if name in WORDS]
    stacks = _stacks(recipe.folder, recipe.top, "patterns", [name for name in names if name not in WORDS], "mask")
    patterns = _normalised(recipe.top, recipe.top.pattern_levels, stacks)
    if not patterns.max() <= 1 or not patterns.min() >= 0:  # also true for NaN
        raise recipe.top.refusal(
            "patterns",
            f"values from {patterns.min():g} to {patterns.max():g}, expected 0 to 1; pattern_levels: what means 1.0",
        )
    if names[len(names) - len(words) :] != words or len(set(words)) < len(words):
        raise recipe.top.refusal("patterns", "all_off and all_on come last and once each")
    even = [np.full((1, *patterns.shape[1:]), word == "all_on", np.float32) for word in words]
    level = recipe.top.pattern_levels
    if level is None and all(stack.dtype.kind in "ui" for stack in stacks):
        level = float(max(np.iinfo(stack.dtype).max for stack in stacks))
    return np.concatenate([patterns, *even]), {word: len(patterns) + index for index, word in enumerate(words)}, level


def _frames(recipe: Recipe, coding: int) -> int:
    sequences = (entry.sequence for entry in recipe.entries)
    listed = [len(sequence) for sequence in sequences if isinstance(sequence, list) and sequence]
    return recipe.top.frames or (listed[0] if listed else coding)


def _measurement(
    folder: Path, entry: CaptureEntry, bit_depth: int, size: tuple[int, ...] | None, whose: str
) -> np.ndarray:
    stacks = _stacks(folder, entry, "measurement", entry.measurement, "meas")
    values = np.concatenate(stacks)
    expected = f"raw DN, whole numbers from 0 to {2**bit_depth - 1} ({bit_depth} bits)"
    if size is not None and values.shape[1:] != size:
        swapped = "; are H and W swapped?" if values.shape[1:] == size[::-1] else ""
        own = "" if swapped or whose != "the patterns" else "; for mirrors on a grid of their own: captures register"
        raise entry.refusal("measurement", f"(H, W) is {values.shape[1:]}, that of {whose} is {size}{swapped or own}")
    # MATLAB stores whole numbers as double; fractions mean that the raw DN were divided
    if values.dtype.kind not in "ui" and not np.equal(values, np.round(values)).all():
        raise entry.refusal("measurement", f"{values.dtype} up to {values.max():g}, expected {expected}")
    if values.min() < 0 or values.max() > 2**bit_depth - 1:
        step = int(np.gcd.reduce(np.unique(values.astype(np.int64))))
        shifted = (
            f"; all are multiples of {step}: divide them by it" if step >= 4 and values.min() < values.max() else ""
        )
        raise entry.refusal(
            "measurement", f"values from {values.min()} to {values.max()}, expected {expected}{shifted}"
        )
    return values.astype(np.uint16)


def _sequence(entry: CaptureEntry, patterns: int, words: dict[str, int], frames: int) -> np.ndarray:
    value = entry.sequence
    if value is None:
        if frames > patterns:
            raise entry.refusal("sequence", f"is missing: {frames} frames, but {patterns} patterns")
        return np.arange(frames)
    listed = value if isinstance(value, list) else [value] * frames
    if len(listed) != frames:
        raise entry.refusal("sequence", f"has {len(listed)} slots, expected {frames} as the other captures")
    slots = [words.get(entered, -1) if isinstance(entered, str) else entered for entered in listed]
    for slot, entered in zip(slots, listed, strict=True):
        if isinstance(slot, bool) or not isinstance(slot, int) or not 0 <= slot < patterns:
            choices = ", ".join((f"0 to {patterns - 1}", *words))
            raise entry.refusal("sequence", f"{entered!r} is no listed pattern, expected {choices}")
    return np.array(slots)


def _scene(folder: Path, entry: CaptureEntry, shape: tuple[int, ...]) -> np.ndarray:
    value = 0.0 if entry.scene is None and entry.kind == "dark" else entry.scene
    if value is None or value == ["unknown"]:
        return np.broadcast_to(np.float32(np.nan), shape)
    if not isinstance(value, list):
        if value < 0:
            raise entry.refusal("scene", f"expected an irradiance of 0 or more, got {value:g}")
        return np.broadcast_to(np.float32(value), shape)
    scene = _normalised(entry, entry.scene_levels, _stacks(folder, entry, "scene", value, "scene"))
    if len(scene) not in (1, shape[0]) or scene.shape[1:] != shape[1:]:
        swapped = "; are H and W swapped?" if scene.shape[1:] == shape[:0:-1] else ""
        raise entry.refusal("scene", f"is {scene.shape}, expected (T, H, W) = {shape} or (H, W){swapped}")
    if not np.isfinite(scene).all() or scene.min() < 0:
        raise entry.refusal("scene", "holds NaN, infinite or negative values, expected irradiances of 0 or more")
    return np.broadcast_to(scene, shape)


def _stacks(folder: Path, node: Node, key: str, names: list[str], prefer: str) -> list[np.ndarray]:
    """Return the images (K, H, W) of every file, in the order of the list and, within a glob, in natural order."""
    paths = [path for name in names for path in _files(folder, node, key, name)]
    if not paths:
        raise node.refusal(key, f"no file is named; {FILE} needs at least one")
    try:
        return read_stack(paths, prefer=prefer)
    except BadInput as error:
        raise node.refusal(key, str(error)) from error


def _files(folder: Path, node: Node, key: str, name: str) -> list[str]:
    """Return the files of the folder that match a name or a glob; files outside it, also behind a link, are refused."""
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise node.refusal(key, f"'{name}' leads out of {folder}; copy the file into this folder")
    try:
        # a file of exactly that name takes precedence over a glob: brackets are legal in names
        matches = (
            [str(folder / name)] if (folder / name).is_file() else glob.glob(str(Path(glob.escape(str(folder)), name)))
        )
    except ValueError:  # a name that no file can have
        matches = []
    if not matches:
        raise node.refusal(key, f"no file fits '{name}' in {folder}")
    for path in matches:
        if not Path(path).resolve().is_relative_to(folder.resolve()):
            raise node.refusal(key, f"{path} is a link out of {folder}; copy the file into this folder")
    return sorted(matches, key=natural)


def _normalised(node: Node, levels: float | None, stacks: list[np.ndarray]) -> np.ndarray:
    """Return float32 values scaled so that ``levels``, or the largest value of an integer type, is 1.0."""
    check_memory(f"{node.where}its numbers", 4 * COPIES * sum(stack.size for stack in stacks))
    scaled = (stack / (levels or (np.iinfo(stack.dtype).max if stack.dtype.kind in "ui" else 1.0)) for stack in stacks)
    return np.concatenate([stack.astype(np.float32) for stack in scaled])
