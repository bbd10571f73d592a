"""The way that is chosen for a convolution is among those that can compute it, and among the fastest."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from sci_lightning.decoder.layers.convolution import WAYS, fastest_way
from tests.conftest import ROOT
from tests.files.formats import check
from tests.studies.benchmark.convolutions import SHAPES, Shape, main, measure


def test_what_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.studies.benchmark.convolutions.SHAPES", [(2, 3, (3, 3, 3), 4)])
    monkeypatch.setattr("torch.set_num_threads", lambda number: None)
    main([str(tmp_path / "a.json")])
    content = json.loads((tmp_path / "a.json").read_text())
    check("measurements", content)
    assert all(row["chosen"] in WAYS and row[row["chosen"]] > 0 for row in content["rows"])


def test_ways_that_cannot_compute_it_are_left_out() -> None:
    row = measure((4, 4, (1, 3, 3), 4), torch.bfloat16, calls=1)
    assert "winograd" not in row and {"frames", "vendor"} <= row.keys()


def test_what_was_measured_is_what_is_chosen() -> None:
    """The committed table, made on one machine, agrees with the rule."""
    rows = json.loads((ROOT / "docs" / "results" / "convolutions.json").read_text())["rows"]
    for row in rows:
        assert row[row["chosen"]] > 0.6 * max(row[name] for name in WAYS if name in row), row


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if min(shape[:2]) >= 32 and shape[2] == (3, 3, 3)])
def test_bfloat16_is_left_to_the_vendor(shape: Shape) -> None:
    inputs, outputs, taps, side = shape
    x, weight = torch.empty(1, inputs, 8, side, side), torch.empty(outputs, inputs, *taps)
    assert fastest_way(x, weight, 1) == "winograd"
    assert fastest_way(x.bfloat16(), weight.bfloat16(), 1) == "vendor"
    with torch.autocast("cpu", torch.bfloat16):
        assert fastest_way(x, weight, 1) == "vendor"
