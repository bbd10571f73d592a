"""What the paper prints, and which rows its tables have: the one place from which sweeps, tables and claims take it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml


def paper_figures() -> dict[str, Any]:
    """Return ``tables``, ``claims`` and ``decoders`` of ``paper_figures.yaml``, which explains them."""
    content: dict[str, Any] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
    return content


def swept(table: str, key: str) -> str:
    """Return what a table's sweep goes through: ``${swept:table5,bits}`` in ``conf/experiment`` is ``1,2,3,4``.

    Args:
        table: of ``paper_figures.yaml``.
        key: of what its rows and columns are matched by.
    """
    parts = paper_figures()["tables"][table]
    matched = [*(row["match"] for row in parts["rows"].values()), *parts["columns"].values()]
    return ",".join(dict.fromkeys(str(fields[key]) for fields in matched if key in fields))
