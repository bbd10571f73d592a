"""A summary of captures for the terminal."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.kind import KINDS
from sci_lightning.homography import covered, pixels_per_mirror


def summary_table(captures: Captures) -> Table:
    """Return a table with one row per kind.

    Its columns are the number of captures, their mean, smallest and largest DN, the part of the pixels at either end of
    the range, and the number of known scenes.
    """
    table = Table("kind", title=captures.name)
    for column in ("captures", "mean DN", "min", "max", "saturated", "at zero", "scenes known"):
        table.add_column(column, justify="right")
    known = captures.known
    for kind in KINDS:
        chosen = np.array([label == kind for label in captures.kind])
        if chosen.any():
            values = captures.measurement[chosen]
            table.add_row(
                kind,
                str(chosen.sum()),
                f"{values.mean():.2f}",
                str(values.min()),
                str(values.max()),
                _percentage(values >= captures.full_scale),
                _percentage(values == 0),
                f"{known[chosen].sum()}",
            )
    return table


def summary_lines(captures: Captures) -> list[str]:
    """Return lines about the camera, and one for every capture whose label contradicts its content."""
    (height, width), patterns = captures.size, len(captures.patterns)
    datasheet = [
        f"read noise {'not stated' if captures.read_noise_dn is None else f'{captures.read_noise_dn:g} DN'}",
        f"full well {'not stated' if captures.full_well_e is None else f'{captures.full_well_e:g} electrons'}",
    ]
    lines = [
        f"N = {len(captures)} captures, H x W = {height} x {width}, T = {captures.frames} slots, "
        f"P = {patterns} patterns",
        *([] if captures.sensor_to_modulator is None else [_grid_line(captures)]),
        f"beyond the patterns: {'no light' if captures.surround == 'dark' else 'unknown'}",
        f"{captures.bit_depth} bits (0 to {captures.full_scale} DN); datasheet: {', '.join(datasheet)}",
    ]
    pairs = zip(captures.kind, captures.inferred_kind, strict=True)
    for index, (label, content) in enumerate(pairs):
        if content not in ("unknown", label) and label != "unknown":
            lines.append(f"capture {index} is labelled {label}, its patterns and scene are those of a {content} one")
    return lines


def _grid_line(captures: Captures) -> str:
    """Return what the homography of a modulator on its own grid means."""
    assert captures.sensor_to_modulator is not None
    (height, width), (rows, columns) = captures.size, captures.mirrors
    across, down = pixels_per_mirror(captures.sensor_to_modulator, captures.size)
    part = covered(captures.sensor_to_modulator, (height, width), (rows, columns)).mean()
    return (
        f"patterns of {rows} x {columns} mirrors, {across:.3g} x {down:.3g} pixels each (wide, high); they cover "
        f"{100 * part:.0f} % of the field"
    )


def _percentage(mask: np.ndarray) -> str:
    return f"{100 * mask.mean():.2f} %" if mask.any() else "0"
