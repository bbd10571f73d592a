"""The tables of a benchmark on the documentation's pages."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.studies.tables.documented import benchmark as build

STEP = {"seconds": 0.5, "fastest": 0.4, "gflops": 60.0}
SPEED = {"product_gflops": 100.0, "convolution_gflops": 90.0, "convolution_training_gflops": 80.0}
COST = {
    "parameters": 0,
    "macs": 5 * 10**9,
    "macs_as_paper": 5 * 10**9,
    "precisions": {"32-true": {"seconds": 0.25, "fastest": 0.2, "calls": 3, "gflops": 40.0, "psnr": 9.0}},
    "machine": {"32-true": SPEED},
    "training": {"snapshots": 4, "precisions": {"32-true": STEP}},
}
CONTENT: dict[str, Any] = {
    "format": "sci-benchmark",
    "format_version": 2,
    "provenance": {"machine": "an abacus", "date": "2026-11-22", "commit": "0123abcd", "scale": "full", "seeds": "0"},
    "torch": "2.13.0",
    "device": "cpu",
    "threads": 1,
    "compile": False,
    "kernels": "auto",
    "failed": {},
    "frames": 8,
    "size": [64, 64],
    "precisions": ["32-true"],
    "product": 2048,
    "scene": "synthetic: camera",
    "weights": "random weights",
    "decoders": {"mine": COST},
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "a.json").write_text(json.dumps(CONTENT))
    return tmp_path / "a.json"


def test_parts(file: Path) -> None:
    forward = build(file, "forward")
    assert forward.heading == ["decoder", "precision", "time (s)", "of conv"]
    assert forward.rows == [["mine", "float32", "0.25", "44%"]] and "an abacus" in forward.as_markdown()
    assert build(file, "training").rows == [["mine", "float32", "4", "0.5", "75%"]]
    assert build(file, "machine").rows[0] == ["matrix product of side 2048", "100"]
    assert build(file, "counts").rows == [["mine", "5.00", "5.00"]]  # an algorithm has no parameters


def test_what_is_not_there(file: Path) -> None:
    with pytest.raises(BadInput, match=r"benchmark\.speed; .*benchmark\.counts, benchmark\.forward"):
        build(file, "speed")
    file.write_text(json.dumps({**CONTENT, "format_version": 1}))
    with pytest.raises(BadInput, match="expected format sci-benchmark 2"):
        build(file, "forward")
