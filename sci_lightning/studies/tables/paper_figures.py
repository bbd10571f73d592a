"""What the paper prints, and which rows its tables have: the one place from which sweeps, tables and claims take it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml


def paper_figures() -> dict[str, Any]:
    """Return ``tables``, ``claims`` and ``decoders`` of ``paper_figures.yaml``, which explains them."""
    content: dict[str, Any] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
    return content
