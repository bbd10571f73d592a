"""``python -m tests.diagnosis.diagnosis_time [JSON]``: how long diagnoses take, in a process of their own each.

It writes the measurements from which the table in docs/results/diagnosis.md is made. The machine should be idle.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import torch

from tests.measurements_file import MeasurementsFile

SHIFT = "{name:mask_shift,dx:0.6,dy:-0.35}"
GAIN = "{name:gain,factor:0.93}"
CONTRAST = "{name:mask_contrast,leak:0.05}"
ROTATION = "{name:mask_rotation,angle:0.5}"
PRNU = "{name:prnu,std:0.03}"
CASES: dict[str, tuple[int, str]] = {
    "64 x 64, nothing": (64, "none"),
    "64 x 64, a shifted mask": (64, f"[{SHIFT}]"),
    "64 x 64, a shifted mask and a gain": (64, f"[{SHIFT},{GAIN}]"),
    "64 x 64, a shifted mask, a leak and a gain": (64, f"[{SHIFT},{CONTRAST},{GAIN}]"),
    "128 x 128, a rotated mask": (128, f"[{ROTATION}]"),
    "128 x 128, a shifted mask, a gain and PRNU": (128, f"[{SHIFT},{GAIN},{PRNU}]"),
    "256 x 256, a rotated mask and PRNU": (256, f"[{ROTATION},{PRNU}]"),
}
"""Side of the field and hidden effects, by description; the world goes on beyond the field, 34 captures."""

DIAGNOSIS = """
import json, resource, sys, time
from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import diagnose
captures, began = read_captures(sys.argv[1]), time.perf_counter()
before = time.process_time()
found = diagnose(captures)
spent = {"seconds": time.perf_counter() - began, "processor_seconds": time.process_time() - before}
spent |= {"effects": ", ".join(found.names), "verdict": found.verdict}
spent["memory_mib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps(spent))
"""


def measured(captures: Path) -> dict[str, Any]:
    """Diagnose a captures file in a process of its own; times without starting Python and without the report."""
    done = subprocess.run([sys.executable, "-c", DIAGNOSIS, str(captures)], check=True, capture_output=True, text=True)
    spent: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return spent


def row(description: str, folder: Path) -> dict[str, Any]:
    """Take the captures of a case and diagnose them."""
    side, hidden = CASES[description]
    camera = [f"out={folder}/captures.h5", f"size=[{side},{side}]", f"effects={hidden}", "seed=1"]
    subprocess.run([sys.executable, "-m", "sci_lightning.virtual_camera", *camera], check=True, capture_output=True)
    return {"34_captures": description, **measured(folder / "captures.h5")}


def main(out: Path, cases: list[str]) -> None:
    file = MeasurementsFile(
        out,
        machine=f"{torch.get_num_threads()} threads",
        scale="sizes in the rows; the world goes on beyond the field",
        seeds="1",
        command="python -m tests.diagnosis.diagnosis_time docs/results/diagnosis-time.json",
    )
    rows: list[dict[str, Any]] = []
    for description in cases:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(row(description, Path(folder)))
        print(json.dumps(rows[-1]), flush=True)
    columns = [
        ("34_captures", "34 captures", None),
        ("seconds", "seconds", 0),
        ("processor_seconds", "processor seconds", 0),
        ("memory_mib", "memory (MiB)", 0),
        ("effects", "effects named", None),
        ("verdict", "verdict", None),
    ]
    file.write(columns, rows)


if __name__ == "__main__":
    words = sys.argv[1:]
    chosen = [case for case in CASES if not words[1:] or any(case.startswith(word) for word in words[1:])]
    main(Path(words[0] if words else "docs/results/diagnosis-time.json"), chosen)
