"""What snapshots tell by themselves, without any mask and without any known scene: the sensor's part of the camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter

from sci_lightning.diagnosis.blind.snapshot_noise import NoiseFacts, noise_facts
from sci_lightning.errors import BadInput
from sci_lightning.files.mask_file import MASK_FILES

DARK_END = 0.02
"""Part of the range above the darkest pixel in which a black level is looked for: further up it may be a dim scene."""
PILE_UP = 0.005
"""Least part of all pixels in a peak at the dark end that counts as the black level."""
CLIPPED = 1e-4
"""Least part of all pixels at an end of the range that counts as clipping."""
LEAST_PILED = 16
"""Pixels with the highest values, two codes of them, from which these count as a pile."""
EXPECTED = 20.0
"""Pixels that a code must be expected to have, judging by its neighbours, for its absence to be no chance."""
DEFECT_SIGMA = 6.0
"""Local standard deviations by which a pixel must differ from its neighbours in every snapshot."""
MOST_DEFECTS = 0.002
"""Larger parts of the pixels are a texture that all snapshots share, and no defects."""
ALIKE = 0.8
"""Correlation above which snapshots count as taken of one scene."""
MOST_LISTED = 20
"""Largest number of defects whose places are listed."""
SHARED_SIGMA = 5.0
"""Standard errors by which an offset that all snapshots share must differ from chance."""


@dataclass(frozen=True)
class Levels:
    """Where the values lie.

    Attributes:
        lowest, highest: smallest and largest DN of all snapshots.
        median: DN.
        black_level: DN of the peak at the dark end; None where the values do not show one.
        at_zero: part of the pixels at 0 DN.
        at_full_scale: part of the pixels at the largest DN, by snapshot.
        saturates_at: DN below full scale at which values pile up; None where they do not.
    """

    lowest: int
    highest: int
    median: float
    black_level: float | None
    at_zero: float
    at_full_scale: tuple[float, ...]
    saturates_at: int | None


@dataclass(frozen=True)
class Codes:
    """Which of the converter's codes occur.

    Attributes:
        missing: number of codes that never occur although their neighbours do.
        of: number of codes of which it can be said.
        step: greatest common divisor of the distances between the codes that occur, DN.
    """

    missing: int
    of: int
    step: int


@dataclass(frozen=True)
class Defects:
    """Pixels that differ from their neighbours in every snapshot.

    Attributes:
        hot, dark: number of pixels that are always brighter, always darker. A dark one may also be a pixel at which the
            mask never opens.
        places: (row, column) of the first ones, the hot ones first.
        decided: whether there are enough snapshots: in a single one, a defect cannot be told from the scene.
    """

    hot: int
    dark: int
    places: tuple[tuple[int, int], ...]
    decided: bool


@dataclass(frozen=True)
class FixedLines:
    """Offsets of rows or columns that all snapshots share.

    Attributes:
        std: standard deviation of the offsets, DN; 0 where nothing is shared.
        sigma: standard errors by which what is shared differs from chance.
        significant: whether that is more than chance.
    """

    std: float
    sigma: float
    significant: bool


@dataclass(frozen=True)
class SnapshotFacts:
    """What snapshots tell by themselves.

    Attributes:
        snapshots: their number.
        size: (H, W) in pixels.
        bit_depth: of the converter.
        levels, codes, defects, rows, columns, noise: see their classes.
    """

    snapshots: int
    size: tuple[int, int]
    bit_depth: int
    levels: Levels
    codes: Codes
    defects: Defects
    rows: FixedLines
    columns: FixedLines
    noise: NoiseFacts

    def describe(self) -> dict[str, Any]:
        """Return all facts as plain data, for JSON."""
        return asdict(self)

    def sentences(self) -> tuple[str, ...]:
        """Return the facts in words, the important ones first, a sentence each."""
        parts = [*_light(self), *_converter(self), *_pixels(self), *_lines(self)]
        return (*parts, self.noise.sentence())


def snapshot_facts(dn: np.ndarray, bit_depth: int, name: str = "") -> SnapshotFacts:
    """Return what snapshots tell by themselves.

    Args:
        dn: ``(N, H, W)`` raw DN, integers.
        bit_depth: of the converter.
        name: of the file, for messages.

    Raises:
        BadInput: fewer than 16 x 16 pixels, in which nothing can be told from chance.
    """
    if min(dn.shape[1:]) < 16:
        last = min(dn.shape[:2]) >= 16 > dn.shape[2]
        advice = "; this one looks like H x W x N: move its last axis to the front" if last else ""
        raise BadInput(
            f"{name}{': ' * bool(name)}snapshots ({len(dn)}) of {dn.shape[1]} x {dn.shape[2]} pixels are too small, "
            f"expected at least 16 x 16; an array of several snapshots is N x H x W{advice}"
        )
    full_scale = 2**bit_depth - 1
    counts = np.bincount(dn.ravel().astype(np.int64), minlength=full_scale + 1)
    levels = _levels(dn, counts, full_scale)
    return SnapshotFacts(
        snapshots=len(dn),
        size=(int(dn.shape[1]), int(dn.shape[2])),
        bit_depth=bit_depth,
        levels=levels,
        codes=_codes(counts),
        defects=_defects(dn),
        rows=_fixed_lines(dn.swapaxes(1, 2)),
        columns=_fixed_lines(dn),
        noise=noise_facts(dn, full_scale, levels.black_level or 0.0),
    )


def still_needed(facts: SnapshotFacts, has_mask: bool, has_known_scenes: bool) -> tuple[str, ...]:
    """Return what would let a diagnosis say more, a sentence each; nothing where masks and known scenes are there."""
    needed = []
    if not has_mask:
        needed.append(
            "the mask: without it nothing can be said of modulator, relay and exposure; give mask=FILE "
            f"({MASK_FILES}), or record one flat field for every pattern"
        )
    if not has_known_scenes:
        needed.append(
            "known scenes: gain, vignetting and the blur of the lens cannot be told from brightness and sharpness of "
            "an unknown scene; python -m sci_lightning.captures plan FOLDER writes a shot list"
        )
    if facts.snapshots == 1:
        needed.append("further snapshots: of one alone, defects and fixed offsets cannot be told from the scene")
    if facts.noise.source != "repeated":
        needed.append("two snapshots of one scene at rest: their difference measures read noise and full well")
    return tuple(needed)


def _levels(dn: np.ndarray, counts: np.ndarray, full_scale: int) -> Levels:
    present = np.flatnonzero(counts)
    total, highest = counts.sum(), int(present[-1])
    at_zero = float(counts[0] / total)
    clipped = tuple(float((image == full_scale).mean()) for image in dn)
    saturates = None
    if present[0] < highest < full_scale:
        top, below = (
            counts[max(0, highest - 1) : highest + 1].sum(),
            counts[max(0, highest - 9) : highest - 1].sum() / 4,
        )
        piled = top >= LEAST_PILED and top > CLIPPED * total and top > 4 * below
        saturates = highest if piled else None
    return Levels(
        lowest=int(present[0]),
        highest=highest,
        median=float(np.median(dn)),
        black_level=_black_level(counts, at_zero, full_scale),
        at_zero=at_zero,
        at_full_scale=clipped,
        saturates_at=saturates,
    )


def _black_level(counts: np.ndarray, at_zero: float, full_scale: int) -> float | None:
    """Return the mean of the peak at the dark end of the histogram; 0 where values are cut off at 0."""
    if at_zero > CLIPPED:
        return 0.0
    if np.count_nonzero(counts) == 1:  # the same everywhere: nothing says that this is black
        return None
    total, lowest = counts.sum(), int(np.flatnonzero(counts)[0])
    dark = counts[: lowest + max(4, int(DARK_END * full_scale))]
    peak = int(dark.argmax())
    width = max(1, full_scale // 500)
    near = slice(max(0, peak - width), peak + width + 1)
    share = counts[near].sum() / total
    after = counts[peak + 3 * width : peak + 5 * width + 1].sum() / total
    if share < PILE_UP or share < 1.5 * after or peak == len(dark) - 1:
        return None
    codes = np.arange(len(counts))[near]
    return float((codes * counts[near]).sum() / counts[near].sum())


def _codes(counts: np.ndarray) -> Codes:
    present = np.flatnonzero(counts)
    step = int(np.gcd.reduce(np.diff(present))) if len(present) > 1 else 1
    if len(counts) <= 8:  # of fewer than 4 bits: every code has neighbours beyond the ends
        return Codes(0, 0, step)
    below = np.convolve(counts, [0, 0, 0, 0, 0, 0.25, 0.25, 0.25, 0.25], mode="same")
    above = np.convolve(counts, [0.25, 0.25, 0.25, 0.25, 0, 0, 0, 0, 0], mode="same")
    inside = np.arange(len(counts))
    judged = (np.minimum(below, above) > EXPECTED) & (inside > present[0]) & (inside < present[-1])
    return Codes(int((judged & (counts == 0)).sum()), int(judged.sum()), step)


def _defects(dn: np.ndarray) -> Defects:
    bright, dark = np.full(dn.shape[1:], np.inf), np.full(dn.shape[1:], -np.inf)
    for image in dn:
        signal = image.astype(np.float32)
        residual = signal - _median_of_neighbours(signal)
        bound = 4 * np.median(np.abs(residual)) + 1
        scale = 1.25 * uniform_filter(np.minimum(np.abs(residual), bound), 15) + 1
        bright, dark = np.minimum(bright, residual / scale), np.maximum(dark, residual / scale)
    decided = len(dn) > 1 and not _all_alike(dn)
    hot, low = ((place & decided) for place in (bright > DEFECT_SIGMA, dark < -DEFECT_SIGMA))
    places = [tuple(place) for mask in (hot, low) for place in np.argwhere(mask).tolist()]
    if max(hot.mean(), low.mean()) > MOST_DEFECTS:
        return Defects(0, 0, (), decided=False)
    return Defects(int(hot.sum()), int(low.sum()), tuple((int(r), int(c)) for r, c in places[:MOST_LISTED]), decided)


def _all_alike(dn: np.ndarray) -> bool:
    """Return whether all snapshots show nearly the same scene, whose details are then in every one of them."""
    first, *others = (image[::2, ::2].ravel().astype(np.float32) for image in dn)
    return all(np.corrcoef(first, other)[0, 1] > ALIKE for other in others if other.std() and first.std())


def _median_of_neighbours(image: np.ndarray) -> np.ndarray:
    """Return the median of the eight neighbours of every pixel."""
    height, width = image.shape
    padded = np.pad(image, 1, mode="reflect")
    shifts = [(r, c) for r in range(3) for c in range(3) if (r, c) != (1, 1)]
    return np.median(np.stack([padded[r : r + height, c : c + width] for r, c in shifts]), 0)


def _fixed_lines(dn: np.ndarray) -> FixedLines:
    """Return the offsets of columns that all snapshots share.

    A column's offset is the weighted mean over its rows of the difference from the mean of the neighbouring columns;
    bright rows, in which mask and scene differ most from column to column, weigh least. Offsets of the upper half of
    one snapshot are correlated with those of the lower half of another one: scene and mask differ there, and only the
    sensor's columns stay. Correlations with displaced columns say what chance gives.
    """
    upper, lower = (np.stack([_column_offsets(image[half]) for image in dn]) for half in _halves(dn.shape[1]))
    upper, lower = (part - part.mean(1, keepdims=True) for part in (upper, lower))
    count, width = upper.shape
    spectra = np.fft.rfft(upper, axis=1), np.fft.rfft(lower, axis=1)
    shared = spectra[0].sum(0) * spectra[1].sum(0).conj()
    if count > 1:
        shared = (shared - (spectra[0] * spectra[1].conj()).sum(0)) / (count * (count - 1))
    covariance = np.fft.irfft(shared, width) / width
    chance = covariance[4 : width - 3]
    sigma = float((covariance[0] - chance.mean()) / max(chance.std(), 1e-12))
    significant = sigma > SHARED_SIGMA and covariance[0] > 0
    return FixedLines(float(np.sqrt(covariance[0] / 1.5)) if significant else 0.0, sigma, bool(significant))


def _halves(length: int) -> tuple[slice, slice]:
    return slice(0, length // 2), slice(length // 2, length)


def _column_offsets(image: np.ndarray) -> np.ndarray:
    """Return the difference of every column from its neighbours, ``(W - 2,)``, DN."""
    signal = image.astype(np.float32)
    difference = signal[:, 1:-1] - 0.5 * (signal[:, :-2] + signal[:, 2:])
    scale = uniform_filter(np.abs(difference), 9) + 1
    weight = 1 / scale**2
    bounded = np.clip(difference, -3 * scale, 3 * scale)
    return np.asarray((weight * bounded).sum(0) / weight.sum(0))


def _light(facts: SnapshotFacts) -> list[str]:
    levels = facts.levels
    clipped = max(levels.at_full_scale)
    full_scale = 2**facts.bit_depth - 1
    if levels.lowest == levels.highest:
        state = "is saturated" if levels.lowest == full_scale else "is the same"
        return [f"every pixel {state} ({levels.lowest} DN): nothing is to be seen; change exposure or aperture"]
    said = []
    if levels.at_zero > CLIPPED:
        said.append(f"no black pedestal: {100 * levels.at_zero:.3g} % of the pixels are cut off at 0 DN")
    elif levels.black_level is not None:
        said.append(
            f"black level near {levels.black_level:.3g} DN: the values pile up there, and it must be subtracted"
        )
    else:
        said.append(f"black level: at most {levels.lowest} DN, no pixel is darker")
    if clipped > CLIPPED:
        said.append(f"up to {100 * clipped:.3g} % of a snapshot's pixels are saturated ({full_scale} DN)")
    elif levels.saturates_at is not None:
        said.append(f"values pile up at {levels.saturates_at} DN, below full scale ({full_scale}): it saturates there")
    else:
        said.append(f"nothing is saturated: the largest value is {levels.highest} of {full_scale} DN")
    return said


def _converter(facts: SnapshotFacts) -> list[str]:
    codes = facts.codes
    if codes.step > 1:
        return [f"every value is a multiple of {codes.step} DN above the lowest: fewer bits than {facts.bit_depth}"]
    if codes.missing:
        return [f"{codes.missing} of {codes.of} codes never occur although their neighbours do"]
    return []


def _pixels(facts: SnapshotFacts) -> list[str]:
    defects = facts.defects
    names = {
        "hot pixel": defects.hot,
        "permanently dark pixel (dead, or the mask never opens there)": defects.dark,
    }
    said = [
        f"{count} {name.replace('pixel', 'pixels', 1) if count > 1 else name}" for name, count in names.items() if count
    ]
    return [" and ".join(said)] if said else []


def _lines(facts: SnapshotFacts) -> list[str]:
    lines: Mapping[str, FixedLines] = {"rows": facts.rows, "columns": facts.columns}
    doubt = "" if facts.snapshots > 1 else "; one snapshot alone, so that the scene may have them"
    return [
        f"fixed {name}: offsets of {fixed.std:.2g} DN (standard deviation) in all snapshots{doubt}"
        for name, fixed in lines.items()
        if fixed.significant
    ]
