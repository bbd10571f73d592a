"""The results of the protocol as tables of texts: a row for every decoder and group of cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sci_lightning.studies.mismatch.cameras import GROUPS
from sci_lightning.studies.mismatch.published import MEANS, SOURCE
from sci_lightning.studies.mismatch.scenarios import SCENARIOS

Record = Mapping[str, Any]


def summary_table(records: Sequence[Record], *, published: bool = False) -> list[list[str]]:
    """Return heading and rows: the published camera, the mean of the drawn ones, and every effect alone.

    Args:
        records: of one run of the protocol.
        published: whether a row with others' published figures follows that of the published camera.
    """
    scenarios = [key for key in SCENARIOS if any(key in record["scenarios"] for record in records)]
    kinds = [kind for kind in ("calibrated", "blind") if any(kind in record.get("recovery", {}) for record in records)]
    heading = [
        "camera",
        "decoder",
        *(SCENARIOS[key].title for key in scenarios),
        *(f"recovery, {kind}" for kind in kinds),
    ]
    rows = []
    for camera in _in_order({record["camera"] for record in records if not record["camera"].startswith("drawn_")}):
        for record in [record for record in records if record["camera"] == camera]:
            rows.append([_camera(record), record["decoder"], *_figures(record, scenarios), *_parts(record, kinds)])
            theirs = MEANS.get(record["decoder"])
            if published and camera == "published" and theirs:
                figures = [f"{theirs[key]:.2f}" if key in theirs else "" for key in scenarios]
                rows.append([f"published by {SOURCE}", record["decoder"], *figures, *("" for _ in kinds)])
        if camera == "published":
            rows += _drawn(records, scenarios, kinds)
    if not any(record["camera"] == "published" for record in records):
        rows = _drawn(records, scenarios, kinds) + rows
    return [heading, *rows]


def _drawn(records: Sequence[Record], scenarios: Sequence[str], kinds: Sequence[str]) -> list[list[str]]:
    """Return a row for every decoder: means over the drawn cameras, and the range of what was won back."""
    rows = []
    drawn = [record for record in records if record["camera"].startswith("drawn_")]
    for decoder in dict.fromkeys(record["decoder"] for record in drawn):
        mine = [record for record in drawn if record["decoder"] == decoder]
        cells = []
        for key in scenarios:  # a mean over fewer cameras would not compare with its neighbours
            values = [record["scenarios"][key]["mean"]["psnr"] for record in mine if key in record["scenarios"]]
            cells.append(f"{sum(values) / len(values):.2f}" if len(values) == len(mine) else "")
        for kind in kinds:
            parts = [record["recovery"][kind] for record in mine if kind in record.get("recovery", {})]
            count = f" ({len(parts)} of {len(mine)})" if len(parts) < len(mine) else ""
            cells.append(f"{100 * min(parts):.1f} to {100 * max(parts):.1f} %{count}" if parts else "")
        rows.append([f"mean of {len(mine)} drawn", decoder, *cells])
    return rows


def _in_order(cameras: set[str]) -> list[str]:
    """Return names of cameras, group by group."""
    return sorted(cameras, key=lambda name: (GROUPS.index(name.partition("_")[0]), name))


def _camera(record: Record) -> str:
    """Return what a camera is called: of one with a single effect, the effect with its parameters."""
    if not record["camera"].startswith("alone_"):
        return str(record["camera"])
    ((name, parameters),) = record["mismatch"].items()
    return f"{name} alone ({', '.join(f'{key} {value:g}' for key, value in parameters.items())})"


def _figures(record: Record, scenarios: Sequence[str]) -> list[str]:
    present = record["scenarios"]
    return [f"{present[key]['mean']['psnr']:.2f}" if key in present else "" for key in scenarios]


def _parts(record: Record, kinds: Sequence[str]) -> list[str]:
    parts = record.get("recovery", {})
    return [f"{100 * parts[kind]:.1f} %" if kind in parts else "" for kind in kinds]
