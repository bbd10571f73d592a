"""Files of measurements (``docs/results/*.json``) as the scripts that measure something write them."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import torch

from sci_lightning.studies.proving_ground.reliability import Proportion

ROOT = Path(__file__).parents[1]
Column = tuple[str, str, int | None]
"""Key, title, and digits behind the point (None for a text)."""


class MeasurementsFile:
    """A file of measurements whose provenance begins now: the load is that before anything is measured.

    Args:
        path: of the JSON file.
        machine: what of it was used, such as ``two cores``.
        scale: of what was measured.
        seeds: of everything random.
        command: that measures it.
        commit: that was measured, earlier, when nobody noted the load; empty for this one, now.
    """

    def __init__(self, path: Path, *, machine: str, scale: str, seeds: str, command: str, commit: str = "") -> None:
        self.path = path
        here = subprocess.run(["git", "rev-parse", "--short=8", "HEAD"], cwd=ROOT, capture_output=True, text=True)
        load = "" if commit else f", load {os.getloadavg()[0]:.1f} when it began"
        self._provenance = {
            "machine": f"{machine}, {platform.machine()}, PyTorch {torch.__version__}{load}",
            "date": date.today().isoformat(),
            "commit": commit or here.stdout.strip(),
            "scale": scale,
            "seeds": seeds,
            "command": command,
        }

    def write(
        self,
        columns: Sequence[Column],
        rows: Sequence[Mapping[str, Any]],
        notes: Sequence[str] = (),
    ) -> None:
        """Write the rows."""
        described = [
            {"key": key, "title": title} | ({} if digits is None else {"digits": digits})
            for key, title, digits in columns
        ]
        content = {
            "format": "sci-measurements",
            "format_version": 1,
            "provenance": self._provenance,
            "columns": described,
            "rows": rows,
            **({"notes": notes} if notes else {}),
        }
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text(json.dumps(content, indent=1) + "\n")


def in_words(answers: Iterable[bool]) -> str:
    """Return how many answers are yes, with the 95 % interval of their share: "9 of 10 (60 % to 98 %)"."""
    return proportion_in_words(Proportion.of(answers))


def proportion_in_words(proportion: Proportion) -> str:
    """Return a proportion in the same words."""
    low, high = (round(100 * end) for end in proportion.interval)
    return f"{proportion.count} of {proportion.total} ({low} % to {high} %)"
