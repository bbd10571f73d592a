"""Table 1: what each encoder is, as the configuration has it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from sci_lightning.cli.command import member
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.tables.grid import Grid


def encoder_table(paper: Mapping[str, Mapping[str, str]]) -> Grid:
    """Every member of ``conf/encoder``, the paper's in its order; inside a running command only.

    Args:
        paper: ``encoders`` of ``paper_figures.yaml``.
    """
    others = sorted(path.stem for path in (CONF / "encoder").glob("*.yaml") if path.stem not in paper)
    rows = [_row(name, paper.get(name, {})) for name in (*paper, *others)]
    heading = ["encoder", "mask", "sensor", "aperture", "in the paper", "the paper's definition"]
    return Grid("table1", "Table 1: definition of the encoders", heading, rows)


def _row(name: str, paper: Mapping[str, str]) -> list[str]:
    encoder = member("train", "encoder", name)
    mask, sensor = (_words(encoder[part]) for part in ("mask", "sensor"))
    return [name, mask, sensor, str(encoder.aperture), paper.get("row", ""), paper.get("configuration", "")]


def _words(part: Mapping[str, Any]) -> str:
    """The class of a mask or a sensor in words, with its bits."""
    kind = str(part["_target_"]).rpartition(".")[2]
    words = re.sub(r"(?<!^)(?=[A-Z])", " ", kind).lower()
    bits = part.get("bits") or part.get("bit_depth")
    return f"{words}, {bits} bits" if bits else words
