"""Noise of snapshots of unknown scenes: read noise and photon transfer from repeated or smooth parts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.signal import convolve2d

ALIKE = 0.98
"""Correlation of two snapshots from which they may show the same scene."""
BINS = 12
"""Levels of brightness at which the noise is measured."""
FEWEST = 400
"""Fewest pixels, and an eighth as many blocks, in a bin of brightness."""
BLOCK = 8
"""Side in pixels of the blocks that may be smooth."""
SMOOTHEST = 0.1
"""Part of the blocks of one brightness that count as smooth: those that vary least."""
QUIETEST = 0.58
"""That quantile of the variances of blocks that hold nothing but white noise, over its variance; simulated."""
OUTLIER = 30.0
"""Squares of differences above so many medians are no noise: something moved. Of noise, two in ten thousand are."""
LAPLACE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]]) / 6.0
"""Passes white noise with its standard deviation, and no plane."""
MAD = 1.4826
"""Standard deviation of normally distributed numbers over their median absolute deviation."""


@dataclass(frozen=True)
class NoiseFacts:
    """Noise against brightness.

    Attributes:
        source: ``repeated`` (two snapshots of the same scene), ``smooth`` (the smoothest blocks, in which what is left
            of mask and scene counts as noise) or ``none``.
        levels: mean DN of the bins, above the black level.
        deviations: standard deviation of the noise in each, DN.
        read_noise_dn: standard deviation without light; None where the bins do not determine it.
        full_well_e: electrons at full scale; None likewise.
    """

    source: str
    levels: tuple[float, ...]
    deviations: tuple[float, ...]
    read_noise_dn: float | None
    full_well_e: float | None

    def sentence(self) -> str:
        """Return this in words."""
        if self.source == "none":
            return "noise: neither a repeated snapshot nor smooth parts show it"
        bound = "" if self.source == "repeated" else "at most about "
        where = "two snapshots of one scene" if self.source == "repeated" else "the smoothest blocks"
        parts = [] if self.read_noise_dn is None else [f"read noise {bound}{self.read_noise_dn:.2g} DN"]
        if self.full_well_e is not None:
            parts.append(
                f"full well {'near' if self.source == 'repeated' else 'at least about'} {self.full_well_e:.2g} e"
            )
        if not parts:
            parts = [
                f"noise {bound}{self.deviations[0]:.2g} DN in the dark, {self.deviations[-1]:.2g} DN at the bright end"
            ]
        return f"{' and '.join(parts)}, from {where}"


def noise_facts(dn: np.ndarray, full_scale: int, black: float) -> NoiseFacts:
    """Measure the noise of snapshots ``(N, H, W)``, raw DN, by their differences or by their smoothest blocks.

    Args:
        dn: raw DN.
        full_scale: the largest DN; pixels there do not count.
        black: black level, DN.
    """
    pairs = _repeated(dn)
    if pairs:
        samples = [_difference(dn[first], dn[second], full_scale) for first, second in pairs]
        source = "repeated"
    else:
        samples = [_smooth_blocks(image, full_scale) for image in dn]
        source = "smooth"
    level, variance = (np.concatenate(parts) for parts in zip(*samples, strict=True))
    bins = _bins(level - black, variance, source)
    if len(bins) < 2:
        return NoiseFacts("none", (), (), None, None)
    levels, variances = np.array(bins).T
    read, slope = _photon_transfer(levels, variances)
    return NoiseFacts(
        source=source,
        levels=tuple(levels.tolist()),
        deviations=tuple(np.sqrt(variances).tolist()),
        read_noise_dn=None if read is None else float(np.sqrt(read)),
        full_well_e=None if slope is None else float((full_scale - black) / slope),
    )


def _repeated(dn: np.ndarray) -> list[tuple[int, int]]:
    """Return pairs of snapshots that differ by noise alone: their difference has no structure of its own.

    A snapshot belongs to one pair at most, so that what the pairs say is independent.
    """
    pairs: list[tuple[int, int]] = []
    for first, second in combinations(range(min(len(dn), 40)), 2):
        if any(number in pair for pair in pairs for number in (first, second)):
            continue
        a, b = dn[first, ::2, ::2].astype(np.float32), dn[second, ::2, ::2].astype(np.float32)
        if a.std() == 0 or b.std() == 0 or np.corrcoef(a.ravel(), b.ravel())[0, 1] < ALIKE:
            continue
        difference = a - b
        rough = (
            float(np.corrcoef(difference[:, 1:].ravel(), difference[:, :-1].ravel())[0, 1]) if difference.std() else 0
        )
        if abs(rough) < 0.1:
            pairs.append((first, second))
    return pairs


def _difference(first: np.ndarray, second: np.ndarray, full_scale: int) -> tuple[np.ndarray, np.ndarray]:
    """Return brightness and half the squared difference of every pixel of two snapshots of one scene."""
    a, b = first.astype(np.float32), second.astype(np.float32)
    usable = (first < full_scale) & (second < full_scale)
    difference = (a - b)[usable]
    return (0.5 * (a + b))[usable], 0.5 * (difference - np.median(difference)) ** 2


def _smooth_blocks(image: np.ndarray, full_scale: int) -> tuple[np.ndarray, np.ndarray]:
    """Return brightness and variance of the fine structure of every block."""
    signal = image.astype(np.float32)
    rough = convolve2d(signal, LAPLACE, mode="valid")
    height, width = (side // BLOCK * BLOCK for side in rough.shape)

    def cut(values: np.ndarray) -> np.ndarray:
        blocks = values[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
        return blocks.swapaxes(1, 2).reshape(-1, BLOCK**2)

    values, inner = cut(rough), cut(signal[1:-1, 1:-1])
    usable = inner.max(1) < full_scale
    deviation = MAD * np.median(np.abs(values[usable]), 1)
    return inner[usable].mean(1), deviation**2


def _bins(level: np.ndarray, variance: np.ndarray, source: str) -> list[tuple[float, float]]:
    """Return (brightness, variance of the noise) for bins of equal numbers of samples."""
    order = np.argsort(level, kind="stable")
    fewest = FEWEST if source == "repeated" else FEWEST // 8
    bins = []
    for part in np.array_split(order, BINS):
        if len(part) < fewest:
            continue
        if source == "repeated":
            moved = variance[part] > OUTLIER * np.median(variance[part])
            typical = float(variance[part][~moved].mean())
        else:
            typical = float(np.quantile(variance[part], SMOOTHEST)) / QUIETEST
        bins.append((float(level[part].mean()), max(typical, 1 / 12)))
    return bins


def _photon_transfer(levels: np.ndarray, variances: np.ndarray) -> tuple[float | None, float | None]:
    """Return the variance without light, and its growth per DN of light; None where the line has no such value."""
    weights = 1 / variances
    slope, read = np.polyfit(levels, variances, 1, w=weights)
    spread = levels.max() - levels.min()
    if not spread > 0 or slope <= 0 or slope * spread < 0.2 * max(read, 1 / 12):
        typical = float(np.average(variances, weights=weights))
        return (typical, None) if variances.max() < 2 * variances.min() else (None, None)
    return (float(read) if read > 1 / 12 else None), float(slope)
