"""The kind of a capture, judged by its patterns and its scene rather than by its label."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

Kind = Literal["dark", "flat", "pattern", "static", "dynamic", "unknown"]
KINDS: tuple[str, ...] = get_args(Kind)
EQUAL = 1e-6
"""Irradiances closer than this count as equal; it is the resolution of float32 near 1."""


def infer_kind(patterns: np.ndarray, sequence: np.ndarray, scene: np.ndarray, aperture: float = 1.0) -> str:
    """Return the kind of one capture by its content.

    It is the first of these that applies:

    - dark: no light before the camera (aperture or scene is 0 everywhere),
    - unknown: the scene is not known (NaN),
    - pattern: every slot shows an all-off pattern, or exactly one of several slots shows another one,
    - dark: aperture * sum_t pattern * scene is 0 everywhere,
    - flat: the scene is constant in space and time,
    - static: all frames of the scene are equal,
    - dynamic: anything else.

    Args:
        patterns: (P, H, W) in [0, 1], or (P, Hm, Wm) on a grid of their own.
        sequence: (T,) index into ``patterns`` for every slot.
        scene: (T, H, W) nominal irradiance, NaN where unknown.
        aperture: light scale of the capture, 0 or more.

    Returns:
        One of :data:`KINDS`.
    """
    if aperture == 0 or not scene.any():  # NaN counts as light
        return "dark"
    if not np.isfinite(scene).all():
        return "unknown"
    shown = [slot for slot, index in enumerate(sequence) if patterns[index].any()]
    if not shown or (len(shown) == 1 and len(sequence) > 1):
        return "pattern"
    if not any(_lights(patterns[sequence[slot]], scene[slot]) for slot in shown):
        return "dark"
    if scene.max() - scene.min() <= EQUAL:
        return "flat"
    return "static" if (np.abs(scene - scene[:1]) <= EQUAL).all() else "dynamic"


def _lights(pattern: np.ndarray, frame: np.ndarray) -> bool:
    """Return whether light passes; of a pattern on a grid of its own only whether both have any."""
    return bool((pattern * frame).any() if pattern.shape == frame.shape else frame.any())


def infer_kinds(patterns: np.ndarray, sequence: np.ndarray, scene: np.ndarray, aperture: np.ndarray) -> tuple[str, ...]:
    """Return :func:`infer_kind` of N captures, given sequence (N, T), scene (N, T, H, W) and aperture (N,)."""
    return tuple(infer_kind(patterns, *capture) for capture in zip(sequence, scene, aperture.tolist(), strict=True))
