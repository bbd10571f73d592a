"""Finding the nominal homography of a modulator: a coarse search, an alignment, and a test of what came out."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.registration.alignment import Alignment, Prepared, align, levels, residual
from sci_lightning.captures.registration.coarse_search import (
    CELLS,
    Candidate,
    CoarseSearch,
    Orientation,
    likely_orientations,
    likely_pitches,
    other_orientations,
)
from sci_lightning.captures.registration.shown_patterns import ShownPattern, shown_patterns
from sci_lightning.errors import BadInput
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
) -> Iterator[tuple[str, Iterator[Candidate], int]]:
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


def _candidates(search: CoarseSearch, orientations: Iterator[Orientation]) -> Iterator[Candidate]:
    for orientation in orientations:
        if (candidate := search.best(orientation)) is not None:
            yield candidate


def _aligned(
    shown: list[ShownPattern],
    candidate: Candidate,
    cell: int,
    field: tuple[int, int],
    mirrors: tuple[int, int],
    perspective: bool,
) -> Registration:
    """Align a candidate and judge it by the finest comparison."""
    steps = levels(field, cell, perspective)
    alignment = align(shown, candidate.matrix, steps)
    matrix = alignment.matrix
    prepared = Prepared(shown, matrix, steps[-1])
    last = prepared.compare(alignment)
    return Registration(
        matrix=matrix,
        distortion=alignment.distortion,
        residual=residual(prepared.compare(Alignment(matrix)), matrix),
        correlation=last.correlation,
        significance=last.significance if covered(matrix, field, mirrors).mean() > LEAST_COVERED else 0.0,
        captures=tuple(sorted(number for pattern in shown for number in pattern.captures)),
    )
