"""Snapshots of unknown scenes: which of them show something, and where in the field."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.model.observation import Observation, grid_of
from sci_lightning.errors import BadInput

NEVER_OPEN = 1e-3
"""Mean transmittance, summed over the slots, below which patterns count as closed."""
SMALLEST = 24
"""Side of the smallest field, in pixels: three blocks, so that one of them is not at the edge."""
LEAST_LIGHT = 0.5
"""DN: a snapshot whose mean is below this is black."""
MOST_SATURATED = 0.5
"""Part of its pixels that may be saturated in a snapshot."""


def observe_snapshots(captures: Captures, leave_out: Collection[int] = ()) -> Observation:
    """Prepare the captures with unknown scenes for a diagnosis.

    The observation's scenes are empty: nothing may read them. Pixels that depend on what lies beyond the patterns do
    not count, even where the captures say that it is dark. Snapshots that are black, even or mostly saturated
    are left out.

    Args:
        captures: of one camera.
        leave_out: numbers of captures that are left out as well.

    Raises:
        BadInput: no capture with an unknown scene, patterns that never open or are the same everywhere, no snapshot
            with light in it, or a field smaller than three blocks of 8 pixels.
    """
    unknown = np.array([n for n in np.flatnonzero(~captures.known) if n not in leave_out], dtype=int)
    if not len(unknown):
        raise BadInput(f"{captures.name}: the scenes of all captures are known; nothing is to be diagnosed blind")
    if min(captures.size) < SMALLEST:
        raise BadInput(
            f"{captures.name}: none of the {len(captures)} captures has a known scene, and snapshots of "
            f"{captures.size[0]} x {captures.size[1]} pixels are too small without; expected at least {SMALLEST} x "
            f"{SMALLEST}, or captures of something known: dark frames, flat fields, single patterns"
        )
    open_ = captures.patterns[captures.sequence[unknown]].sum(1).mean((1, 2))
    if (open_ < NEVER_OPEN).all():
        raise BadInput(
            f"{captures.name}: the patterns of the {len(unknown)} captures with unknown scenes never open (mean "
            f"transmittance {open_.max():.2g}); expected coding patterns: check the mask "
            "('patterns' and 'sequence' of a captures file)"
        )
    used = captures.patterns[np.unique(captures.sequence[unknown])]
    if (used.max((1, 2)) == used.min((1, 2))).all():
        raise BadInput(
            f"{captures.name}: every pattern of the {len(unknown)} captures with unknown scenes is the same "
            "everywhere, so that it codes nothing; expected coding patterns: check the mask "
            "('patterns' and 'sequence' of a captures file)"
        )
    kept = usable_snapshots(captures, leave_out)
    if not len(kept):
        saturated = (captures.measurement[unknown] == captures.full_scale).mean((1, 2)).max() > MOST_SATURATED
        state = f"saturated ({captures.full_scale} DN)" if saturated else "black or without detail"
        raise BadInput(f"{captures.name}: every snapshot is {state}: change exposure or aperture")
    sequences, sequence = torch.unique(torch.from_numpy(captures.sequence[kept]), dim=0, return_inverse=True)
    return Observation(
        patterns=torch.from_numpy(captures.patterns),
        sequences=sequences,
        sequence=sequence,
        scene=[torch.empty(0)] * len(kept),
        aperture=torch.from_numpy(captures.aperture[kept])[:, None, None],
        exposure=torch.from_numpy(captures.exposure[kept])[:, None, None],
        dn=torch.from_numpy(captures.measurement[kept].astype(np.float32)),
        bit_depth=captures.bit_depth,
        kinds=("unknown",) * len(kept),
        number=torch.from_numpy(kept),
        read_noise=captures.read_noise_dn,
        full_well=captures.full_well_e,
        position=torch.from_numpy(kept),
        dark_surround=False,  # an offset that has not been found yet would count most where no light is expected
        grid=grid_of(captures),
    )


def usable_snapshots(captures: Captures, leave_out: Collection[int] = ()) -> np.ndarray:
    """Return the numbers of the captures with unknown scenes that show something.

    Args:
        captures: of one camera.
        leave_out: numbers of captures that are left out.
    """
    unknown = [int(n) for n in np.flatnonzero(~captures.known) if n not in leave_out]
    useless = useless_snapshots(captures, leave_out)
    return np.array([number for number in unknown if number not in useless], dtype=int)


def useless_snapshots(captures: Captures, leave_out: Collection[int] = ()) -> dict[int, str]:
    """Return why captures with unknown scenes show nothing, by their numbers; arguments as of ``usable_snapshots``."""
    reasons = {}
    for number in (int(n) for n in np.flatnonzero(~captures.known) if n not in leave_out):
        dn = captures.measurement[number]
        if dn.mean() < LEAST_LIGHT:
            reasons[number] = "black"
        elif (dn == captures.full_scale).mean() > MOST_SATURATED:
            reasons[number] = "mostly saturated"
        elif dn.max() == dn.min():
            reasons[number] = "the same everywhere"
        elif captures.patterns[captures.sequence[number]].sum(0).mean() < NEVER_OPEN:
            reasons[number] = "taken behind closed patterns"
    return reasons


def textured_part(captures: Captures, side: int, leave_out: Collection[int] = ()) -> Captures:
    """Return the square part of the field in which the snapshots vary most, as captures of a smaller field.

    A field that is no larger, and patterns on a grid of their own, are returned as they are.

    Args:
        captures: of one camera.
        side: of the part, in pixels.
        leave_out: numbers of captures that are not looked at.
    """
    if max(captures.size) <= side or captures.sensor_to_modulator is not None:
        return captures
    looked_at = [n for n in np.flatnonzero(~captures.known) if n not in leave_out]
    measurement = torch.from_numpy(captures.measurement[looked_at].astype(np.float32)) / captures.full_scale
    rows, columns = textured_window(measurement, side, border=SMALLEST)
    scene = captures.scene if captures.scene.shape[-2:] == (1, 1) else captures.scene[..., rows, columns]
    return replace(
        captures,
        patterns=np.ascontiguousarray(captures.patterns[:, rows, columns]),
        measurement=np.ascontiguousarray(captures.measurement[:, rows, columns]),
        scene=scene,
    )


def textured_window(measurement: torch.Tensor, side: int, border: int = 0) -> tuple[slice, slice]:
    """Return the square window in which all snapshots together vary most, as rows and columns.

    Args:
        measurement: ``(N, H, W)``, normalised by full scale; pixels at full scale count as if they did not vary.
        side: of the window in pixels; a smaller field is taken whole.
        border: pixels along the sides that the window avoids where the field is large enough.
    """
    height, width = measurement.shape[-2:]
    border = min(border, max(0, (min(height, width) - side) // 2))
    h, w = min(side, height - 2 * border), min(side, width - 2 * border)
    usable = (measurement < 1).float()
    spread = measurement.flatten(1).std(1).clamp(min=1e-9)[:, None, None]
    level = usable * measurement / spread
    texture = F.pad(level.diff(dim=1).square(), (0, 0, 0, 1)) + F.pad(level.diff(dim=2).square(), (0, 1))
    variance = F.avg_pool2d(texture.mean(0)[None], (h, w), max(1, side // 8))[0]
    step = max(1, side // 8)
    rows, columns = variance.shape
    allowed = [
        (float(variance[r, c]), r * step, c * step)
        for r in range(rows)
        for c in range(columns)
        if border <= r * step <= height - h - border and border <= c * step <= width - w - border
    ]
    _, top, left = max(allowed, default=(0.0, border, border))
    return slice(top, top + h), slice(left, left + w)
