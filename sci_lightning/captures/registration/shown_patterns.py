"""What is compared in a registration: images of known patterns on even targets, and what was displayed for them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter

from sci_lightning.captures.captures import Captures
from sci_lightning.errors import BadInput

LEAST_CONTRAST = 0.01
"""Standard deviation of what is displayed, as a part of its mean, below which it shows no places."""
UNEVEN = 0.02
"""Standard deviation of a known scene, as a part of its mean, above which it is no even target."""
MOST_PATTERNS = 6
"""Patterns that are compared, those of most contrast: more do not say more about where they lie."""
FEWEST_DIFFERING = 3
"""Patterns whose differences show which part of the field sees the modulator."""
NEIGHBOURHOOD = 1 / 32
"""Standard deviation, in the field's longer side, of the blur over which these differences are averaged."""
SEEN = 0.1
"""Variance between the patterns, as a part of a high one, above which a pixel sees the modulator."""
NEARLY_ALL = 0.97
"""Part of the field from which it counts as whole."""


@dataclass(frozen=True)
class ShownPattern:
    """One displayed pattern and its image.

    Attributes:
        mirrors: (Hm, Wm) float32, what was displayed, summed over the slots; 1 where a mirror is on all the time.
        image: (H, W) float32, the mean of its captures, divided by that of an evenly lit modulator where there is one.
        captures: numbers of the captures.
        part: (H, W) bool, which pixels see the modulator; None for all of them, or where it is not known.
    """

    mirrors: np.ndarray
    image: np.ndarray
    captures: tuple[int, ...]
    part: np.ndarray | None = None

    def part_in(self, cells: tuple[slice, ...], shape: tuple[int, int, int, int]) -> np.ndarray | None:
        """Return :attr:`part` of a part of the field in cells of ``shape`` (rows, side, columns, side)."""
        return None if self.part is None else self.part[cells].reshape(shape).mean((1, 3)) > 0.5


def shown_patterns(captures: Captures) -> list[ShownPattern]:
    """Return the patterns with contrast that were shown to an even target, those of most contrast first.

    A capture of an unknown scene counts as one of an even target, as long as none of an even one shows a pattern.
    Captures that show the same are averaged. A capture of the same target with all mirrors on divides out uneven light.

    Raises:
        BadInput: no capture shows a pattern with contrast, or all of them show it to a known scene that is not even.
    """
    even, unknown = _grouped(captures)
    flat = _even_light(captures, even)
    shown = _with_contrast(captures, even, flat) or _with_contrast(captures, unknown, flat)
    if not shown:
        lit = [group for group in (*even, *unknown) if group[0].any()]
        what = (
            "every pattern that is shown to an even target is the same everywhere"
            if lit
            else "no pattern is shown to an even target or an unknown scene"
        )
        raise BadInput(
            f"{captures.path or captures.name}: {what}, so that nothing says where the mirrors lie; expected a capture "
            "of a pattern with contrast before an even target"
        )
    part = _differing(captures, shown[:MOST_PATTERNS])
    return [replace(pattern, part=part) for pattern in shown[:MOST_PATTERNS]]


def _differing(captures: Captures, shown: list[ShownPattern]) -> np.ndarray | None:
    """Return where patterns differ in their images, (H, W) bool: there the field sees the modulator, else its frame."""
    if len(shown) < FEWEST_DIFFERING:
        return None
    images = np.stack([captures.measurement[list(one.captures)].mean(0, dtype=np.float64) for one in shown])
    images /= images.mean((1, 2), keepdims=True).clip(1e-6)
    near = NEIGHBOURHOOD * max(captures.size)
    fine = images - gaussian_filter(images, (0, near, near), mode="nearest")  # leaking light differs, but smoothly
    variance = gaussian_filter(fine.var(0), near, mode="nearest")
    part = variance > SEEN * np.percentile(variance, 90)
    return part if part.mean() < NEARLY_ALL else None


Group = tuple[np.ndarray, list[int]]


def _grouped(captures: Captures) -> tuple[list[Group], list[Group]]:
    """Return what is displayed and the captures of it, for even targets and for unknown scenes."""
    even: dict[tuple[tuple[int, float], ...], list[int]] = {}
    unknown: dict[tuple[tuple[int, float], ...], list[int]] = {}
    for number, (sequence, scene) in enumerate(zip(captures.sequence, captures.scene, strict=True)):
        if captures.aperture[number] == 0:
            continue
        if not np.isfinite(scene).all():
            levels, groups = np.ones(len(sequence)), unknown
        else:
            levels, groups = scene.mean((1, 2)), even
            if not levels.any() or scene.std((1, 2)).max() > UNEVEN * levels.max():
                continue
        shares: dict[int, float] = {}
        for pattern, level in zip(sequence.tolist(), levels.tolist(), strict=True):
            shares[pattern] = shares.get(pattern, 0.0) + level / (float(levels.max()) * len(sequence))
        key = tuple(sorted((pattern, round(share, 6)) for pattern, share in shares.items()))
        groups.setdefault(key, []).append(number)

    def summed(groups: dict[tuple[tuple[int, float], ...], list[int]]) -> list[Group]:
        return [
            (sum((share * captures.patterns[pattern] for pattern, share in key), np.zeros(captures.mirrors)), numbers)
            for key, numbers in groups.items()
        ]

    return summed(even), summed(unknown)


def _contrast(mirrors: np.ndarray) -> float:
    mean = float(mirrors.mean())
    return float(mirrors.std()) / mean if mean > 0 else 0.0


def _even_light(captures: Captures, groups: list[Group]) -> np.ndarray | None:
    """Return the image (H, W) of an evenly lit modulator, of mean 1; None if there is none or it is saturated."""
    lit = [group for group in groups if group[0].mean() > 0.5 and _contrast(group[0]) < LEAST_CONTRAST]
    for _, numbers in lit:
        image = captures.measurement[numbers].mean(0)
        if 0 < image.mean() < 0.95 * captures.full_scale and image.min() > 0.05 * image.mean():
            return np.asarray(image / image.mean())
    return None


def _with_contrast(captures: Captures, groups: list[Group], flat: np.ndarray | None) -> list[ShownPattern]:
    shown = []
    for mirrors, numbers in groups:
        if _contrast(mirrors) > LEAST_CONTRAST:
            image = captures.measurement[numbers].mean(0, dtype=np.float64)
            image = image if flat is None else image / flat
            shown.append(ShownPattern(mirrors.astype(np.float32), image.astype(np.float32), tuple(numbers)))
    return sorted(shown, key=lambda one: -float(one.mirrors.std()))
