"""What rows would take: counted, at rates that the stored results bear out."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from sci_lightning.studies.tables.plan_cost import ALIKE, RATES, rate
from tests.conftest import ROOT

RESULTS = ROOT / "docs" / "results"
WITHIN = 0.3
"""Part by which the hours of a row may differ from what it took."""


def kept(*folders: str) -> list[dict[str, Any]]:
    """Rows that are kept with their steps, each tested through its own encoder."""
    files = [file for folder in folders for file in sorted((RESULTS / "tables" / folder).glob("*/seed?.json"))]
    return [row for file in files if "training_steps" in (row := json.loads(file.read_text()))]


def seconds_of(row: dict[str, Any], device: str) -> float:
    """What the steps of a kept row would take by the rates."""
    config = row["config"]
    part = math.prod(config["crop"]) / math.prod(config["size"])
    macs = row["macs"] * part
    return 6 * macs * config["batch_size"] * row["training_steps"] / rate(device, row["decoder"], macs)


def test_rows_of_a_core_took_what_is_expected() -> None:
    """All networks but Res2former-L, whose attention no rate was measured for; 45 minutes of a core each."""
    rows = [row for row in kept("cpu") if "AMD EPYC" in row["provenance"]["machine"]]
    rows = [row for row in rows if row["decoder"] != "res2former_l"]
    assert len(rows) > 20 and len({row["decoder"] for row in rows}) == 8
    for row in rows:
        taken = 60 * row["config"]["core_minutes"]
        assert abs(seconds_of(row, "core") / taken - 1) < WITHIN, (row["encoder"], row["decoder"])


def test_rows_of_a_gpu_took_what_is_expected() -> None:
    """Four at once, each 400 seconds long."""
    rows = kept("gpu30_7_minutes", "gpu30_7_minutes_designed")
    assert len(rows) == 4
    for row in rows:
        assert row["config"]["trainer"]["max_time"] == "00:00:06:40"
        assert abs(4 * seconds_of(row, "h100") / 400 - 1) < WITHIN


def test_the_rates_are_those_of_the_files() -> None:
    files = [RESULTS / "benchmark" / f"training_{name}.json" for name in ("e2e_cnn", "res2former", "reduced")]
    measured = {}
    for file in files:
        for name, cost in json.loads(file.read_text())["decoders"].items():
            measured[name, f"{cost['macs']:.2e}"] = cost["training"]["precisions"]["bf16-mixed"]["gflops"]
    assert {(one.decoder, f"{one.macs:.2e}"): 1e-9 * one.operations for one in RATES["core"]} == {
        key: pytest.approx(value, rel=0.01) for key, value in measured.items()
    }


def test_a_rate_is_of_the_most_similar_network() -> None:
    full, small = (one.operations for one in RATES["core"] if one.decoder == "res2former")
    assert (rate("core", "res2former", 6e10), rate("core", "res2former", 5e8)) == (full, small)
    assert small < rate("core", "metasci", 4e8) < full  # the median of what is as small
    assert rate("h100", "res2former", 861e9) == RATES["h100"][0].operations  # nothing is within ALIKE times
    assert 861e9 / RATES["h100"][0].macs > ALIKE
