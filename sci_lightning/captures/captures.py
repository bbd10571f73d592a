"""Calibration captures of one camera in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sci_lightning.captures.kind import infer_kinds

SURROUNDS = ("unknown", "dark")
"""What a captures file may say about the world beyond the patterns; the first is what silence means."""


@dataclass(frozen=True, eq=False)
class Captures:
    """N captures of T slots, H x W pixels each.

    The nominal measurement is ``clip(aperture * sum_t patterns[sequence[t]] * scene[t], 0, 1) * full_scale``.

    Attributes:
        patterns: (P, H, W) float32 in [0, 1], the commanded patterns of the modulator; (P, Hm, Wm) on its own grid.
        sequence: (N, T) int64, index into ``patterns`` for every slot.
        measurement: (N, H, W) uint8 or uint16, raw DN.
        scene: (N, T, H, W) float32, nominal irradiance, 0 or more; all NaN for a capture whose scene is unknown.
        aperture: (N,) float32, light scale, 0 or more.
        exposure: (N,) float32, integration time relative to nominal, 0 or more.
        kind: N labels, members of :data:`~sci_lightning.captures.kind.KINDS`.
        bit_depth: 1 to 16.
        read_noise_dn: standard deviation of the read noise in DN by the datasheet; None if it is not stated.
        full_well_e: electrons at full scale by the datasheet; None if it is not stated.
        name: of the camera or the session, for people.
        surround: what lies beyond the patterns, a member of :data:`SURROUNDS`: ``dark`` for no light, ``unknown`` where
            nobody has said it.
        verification: numbers of the captures that no fit and no choice of a model may see; None where nobody has chosen
            them, so that a diagnosis does.
        path: the file that was read; None for captures that were never in a file.
        sensor_to_modulator: (3, 3) float64, nominal homography of patterns on the modulator's own grid, see
            :mod:`~sci_lightning.homography`; None where every mirror is a pixel, or nobody has registered them.
    """

    patterns: np.ndarray
    sequence: np.ndarray
    measurement: np.ndarray
    scene: np.ndarray
    aperture: np.ndarray
    exposure: np.ndarray
    kind: tuple[str, ...]
    bit_depth: int
    read_noise_dn: float | None = None
    full_well_e: float | None = None
    name: str = ""
    path: Path | None = None
    surround: str = "unknown"
    verification: tuple[int, ...] | None = None
    sensor_to_modulator: np.ndarray | None = None

    def __len__(self) -> int:
        """The number of captures, N."""
        return len(self.measurement)

    @property
    def full_scale(self) -> int:
        """The largest DN, 2**bit_depth - 1."""
        return int(2**self.bit_depth - 1)

    @property
    def frames(self) -> int:
        """Slots per capture, T."""
        return int(self.sequence.shape[1])

    @property
    def size(self) -> tuple[int, int]:
        """Height and width (H, W) in pixels."""
        height, width = self.measurement.shape[1:]
        return int(height), int(width)

    @property
    def mirrors(self) -> tuple[int, int]:
        """Height and width of the patterns, which differ from :attr:`size` on a grid of their own."""
        height, width = self.patterns.shape[1:]
        return int(height), int(width)

    @property
    def known(self) -> np.ndarray:
        """(N,) bool: whether the scene of the capture is known at every pixel of every frame."""
        return np.array([np.isfinite(scene).all() for scene in self.scene], bool)

    @property
    def inferred_kind(self) -> tuple[str, ...]:
        """N kinds judged by content, whatever the labels say; see :func:`~sci_lightning.captures.kind.infer_kind`."""
        return infer_kinds(self.patterns, self.sequence, self.scene, self.aperture)

    def take(self, indices: Sequence[int] | Sequence[bool] | np.ndarray) -> Captures:
        """Return some of the captures, with all the patterns.

        Args:
            indices: numbers of captures in the wanted order, or one boolean for every capture.

        Raises:
            IndexError: a number that is not below N, or a number of booleans other than N.
        """
        chosen = np.asarray(indices)
        chosen = np.arange(len(self))[chosen if chosen.size or chosen.dtype == bool else chosen.astype(int)]
        kept = None
        if self.verification is not None:
            kept = tuple(place for place, index in enumerate(chosen.tolist()) if index in self.verification)
        return replace(
            self,
            verification=kept,
            sequence=self.sequence[chosen],
            measurement=self.measurement[chosen],
            scene=self.scene[chosen],
            aperture=self.aperture[chosen],
            exposure=self.exposure[chosen],
            kind=tuple(self.kind[index] for index in chosen),
        )
