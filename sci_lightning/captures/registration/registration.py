"""The nominal homography of a modulator: found by a coarse search and an alignment, tested, written into a file."""

from __future__ import annotations

import heapq
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import yaml

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.pack import assemble_captures
from sci_lightning.captures.read import FORMAT_VERSION, read_captures
from sci_lightning.captures.recipe import FILE, read_recipe
from sci_lightning.captures.registration.alignment import Alignment, PatternsAtLevel, align, levels, residual
from sci_lightning.captures.registration.coarse_search import (
    CELLS,
    CoarseSearch,
    Orientation,
    PlacementCandidate,
    ShownPattern,
    likely_orientations,
    likely_pitches,
    other_orientations,
    shown_patterns,
)
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.yaml_file import read_yaml
from sci_lightning.homography import LEAST_COVERED, check_homography, covered

LEAST_SIGNIFICANCE = 14.0
"""Standard deviations of the correlation of unrelated images that a registration must exceed. The best of the millions
of places that are compared, with eight numbers fitted to it, reaches 10 by chance."""
ALIGNED = 6
"""Candidates of a coarse search that are aligned; the right one is nearly always the first."""
MOST_NAMED = 6
"""Captures that a message names."""
ASPECTS = (1.0, 2.0, 0.5)
"""Pitches across over pitches down: square mirrors, and mirrors in a diamond array whose rows are half as high."""


@dataclass(frozen=True)
class Registration:
    """Where the mirrors of a modulator lie in the field.

    Attributes:
        matrix: (3, 3) float64 homography, from (x, y, 1) of a pixel's centre to (u, v, 1) in mirrors.
        distortion: radial distortion of the lens, as the parameter of ``mask_distortion``, that was fitted beside the
            homography; 0 where none is seen.
        residual: pixels, r.m.s., by which the patterns lie beside their images without the distortion.
        correlation: of the patterns with their images, 0 to 1.
        significance: the same in standard deviations of that of unrelated images.
        captures: numbers of the captures that were compared.
    """

    matrix: np.ndarray
    distortion: float
    residual: float
    correlation: float
    significance: float
    captures: tuple[int, ...]


def register(
    captures: Captures,
    perspective: bool = True,
    pitch: tuple[float, float] | None = None,
    on_progress: Callable[[str], None] = lambda message: None,
) -> Registration:
    """Find the nominal homography of the patterns.

    Args:
        captures: some of which show a pattern with contrast to an even target; its brightness need not be known.
        perspective: whether the homography may be perspective; False for an affine one.
        pitch: pixels from one mirror to the next, across and down, if they are known to a tenth; None to find them.
        on_progress: called with a one-line message after every step of the search.

    Raises:
        BadInput: no pattern with contrast, or none that can be found in its image.
    """
    shown = shown_patterns(captures)
    compared = [number for pattern in shown for number in pattern.captures]
    if not captures.known[compared].any():
        numbers = ", ".join(map(str, compared[:MOST_NAMED])) + (", ..." if len(compared) > MOST_NAMED else "")
        on_progress(
            f"no pattern is shown to a target that is known to be even: the unknown scenes of captures {numbers} are "
            "taken for even ones"
        )
    best: Registration | None = None
    for what, search, cell in _searches(shown, captures.size, captures.mirrors, pitch):
        on_progress(f"{what}, in cells of {cell} x {cell} pixels")
        for candidate in heapq.nlargest(ALIGNED, search, key=lambda candidate: candidate.score):
            made = _aligned(shown, candidate, cell, captures.size, captures.mirrors, perspective)
            if best is None or made.significance > best.significance:
                best = made
        if best is not None and best.significance > LEAST_SIGNIFICANCE:
            break
    name = captures.path or captures.name
    if best is None or best.significance < LEAST_SIGNIFICANCE:
        said = "" if best is None else f" (best correlation {best.correlation:.2f})"
        raise BadInput(
            f"{name}: no pattern can be found in its image{said}; expected captures of an even target that show "
            "the commanded patterns with contrast, in focus, with no other structure; a known 'pitch=[ACROSS,DOWN]' in "
            "pixels per mirror helps"
        )
    check_homography(best.matrix, captures.size, captures.mirrors)
    return best


def _searches(
    shown: list[ShownPattern], field: tuple[int, int], mirrors: tuple[int, int], pitch: tuple[float, float] | None
) -> Iterator[tuple[str, Iterator[PlacementCandidate], int]]:
    """Yield what is tried, the candidates that it gives, and its cells' side in pixels; the likeliest first."""
    if pitch is None:
        pitches = [one for aspect in ASPECTS for one in likely_pitches(field, mirrors, aspect)]
    else:
        pitches = [(pitch[0] * factor, pitch[1] * factor) for factor in (1.0, 0.92, 1.08)]
    cell = max(1, -(-max(field) // CELLS))
    while True:
        search = CoarseSearch(shown, cell)
        yield "rows nearly level or upright", _candidates(search, likely_orientations(pitches)), cell
        yield "any rotation", _candidates(search, other_orientations(pitches)), cell
        if cell == 1:
            return
        cell = max(1, cell // 2)  # patterns without coarse structure show where they lie in finer cells only


def _candidates(search: CoarseSearch, orientations: Iterator[Orientation]) -> Iterator[PlacementCandidate]:
    for orientation in orientations:
        if (candidate := search.best(orientation)) is not None:
            yield candidate


def _aligned(
    shown: list[ShownPattern],
    candidate: PlacementCandidate,
    cell: int,
    field: tuple[int, int],
    mirrors: tuple[int, int],
    perspective: bool,
) -> Registration:
    """Align a candidate and judge it by the finest comparison."""
    steps = levels(field, cell, perspective)
    alignment = align(shown, candidate.matrix, steps)
    matrix = alignment.matrix
    prepared = PatternsAtLevel(shown, matrix, steps[-1])
    last = prepared.compare(alignment)
    return Registration(
        matrix=matrix,
        distortion=alignment.distortion,
        residual=residual(prepared.compare(Alignment(matrix)), matrix),
        correlation=last.correlation,
        significance=last.significance if covered(matrix, field, mirrors).mean() > LEAST_COVERED else 0.0,
        captures=tuple(sorted(number for pattern in shown for number in pattern.captures)),
    )


KEY = "sensor_to_modulator"


def read_unregistered(path: str | Path, again: bool = False) -> Captures:
    """Read a captures file, or the folder of one that is not packed yet, whose patterns need not be registered.

    Args:
        path: a captures file, or a folder with ``captures.yaml``.
        again: whether it may have a homography already.

    Raises:
        BadInput: it cannot be read, or has a homography already.
    """
    path = Path(path)
    if path.is_dir():
        captures = assemble_captures(path, registered=False)
        written, key = path / FILE, KEY
    else:
        captures = read_captures(path, registered=False)
        written, key = path, f"attribute '{KEY}'"
    if captures.sensor_to_modulator is not None and not again:
        raise BadInput(f"{written}: has a homography already ({key}); again=true finds it anew")
    return captures


def write_homography(path: str | Path, matrix: np.ndarray) -> Path:
    """Write a homography into a captures file or into a folder's ``captures.yaml``, whole or not at all.

    Everything else in the file stays as it is; a captures file becomes one of version 2.

    Args:
        path: a captures file, or a folder with ``captures.yaml``.
        matrix: (3, 3).

    Returns:
        the file that was written.

    Raises:
        BadInput: the file would be refused afterwards, or cannot be written.
        MachineFailure: the disk is full.
    """
    path = Path(path)
    if path.is_dir():
        return _into_recipe(path, matrix)
    content = io.BytesIO(path.read_bytes())  # in memory, as a disk that is full while HDF5 writes crashes the process
    with h5py.File(content, "r+") as file:
        file.attrs[KEY] = np.array(matrix, np.float64)
        file.attrs["format_version"] = FORMAT_VERSION
    with atomic_write(path) as temporary:
        temporary.write_bytes(content.getbuffer())
        read_captures(temporary, called=path)
    return path


def _into_recipe(folder: Path, matrix: np.ndarray) -> Path:
    recipe = folder / FILE
    rows = [[float(number) for number in row] for row in matrix]
    read_recipe(folder)  # raises BadInput for what is none
    wanted = {**read_yaml(recipe), KEY: rows}
    text = re.sub(rf"^{KEY}:.*\n?(?:(?:[ \t]+\S.*|-.*|\].*)\n?)*", "", recipe.read_text(encoding="utf-8"), flags=re.M)
    line = f"{KEY}: [{', '.join(str(row) for row in rows)}]  # found by captures register\n"
    with atomic_write(recipe) as temporary:
        temporary.write_text(text + ("" if text.endswith("\n") else "\n") + line, encoding="utf-8")
        if not _says(temporary, wanted):  # a file in braces, for instance: its comments are lost
            temporary.write_text(yaml.safe_dump(wanted, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return recipe


def _says(path: Path, wanted: dict[str, object]) -> bool:
    try:
        return bool(read_yaml(path) == wanted)
    except BadInput:
        return False
