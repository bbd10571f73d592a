"""Table 1: what each encoder is, as the configuration has it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from sci_lightning.studies.tables.grid import Grid


def encoder_table(paper: Mapping[str, Mapping[str, str]], encoders: Mapping[str, Mapping[str, Any]]) -> Grid:
    """Return a row for each encoder, the paper's first and in its order.

    Args:
        paper: ``encoders`` of ``paper_figures.yaml``.
        encoders: plain configurations of ours by name.
    """
    others = [name for name in encoders if name not in paper]
    rows = [_row(name, encoders[name], paper.get(name, {})) for name in (*paper, *others)]
    heading = ["encoder", "mask", "sensor", "aperture", "in the paper", "the paper's definition"]
    return Grid("table1", "Table 1: definition of the encoders", heading, rows)


def _row(name: str, encoder: Mapping[str, Any], paper: Mapping[str, str]) -> list[str]:
    mask, sensor = (_words(encoder[part]) for part in ("mask", "sensor"))
    return [name, mask, sensor, str(encoder["aperture"]), paper.get("row", ""), paper.get("configuration", "")]


def _words(part: Mapping[str, Any]) -> str:
    """The class of a mask or a sensor in words, with its bits."""
    kind = str(part["_target_"]).rpartition(".")[2]
    words = re.sub(r"(?<!^)(?=[A-Z])", " ", kind).lower()
    bits = part.get("bits") or part.get("bit_depth")
    return f"{words}, {bits} bits" if bits else words
