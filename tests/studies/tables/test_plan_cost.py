"""What rows would take: counted, at rates that the stored results bear out."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.cli.composition import compose, plain
from sci_lightning.studies.tables.plan_cost import ALIKE, RATES, rate, row_plan
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


def first_row(decoder: str) -> dict[str, Any]:
    """The row of which a network's rate on a core is."""
    name = f"lsw_sr_4bit_{decoder}" if decoder.startswith("res2former") else f"rbw_osr_1bit_{decoder}"
    return json.loads((RESULTS / "tables" / "cpu" / name / "seed0.json").read_text())


def test_rows_of_a_core_took_what_is_expected() -> None:
    """All that were trained on the processor of which the rates are, for 45 minutes each."""
    rows = [row for row in kept("cpu") if "AMD EPYC" in row["provenance"]["machine"]]
    others = [row for row in rows if row != first_row(row["decoder"])]
    assert len(others) > 15 and {row["decoder"] for row in rows} == {one.decoder for one in RATES["core"]}
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
    *rows, full = RATES["core"]
    for one in rows:
        row = first_row(one.decoder)
        assert seconds_of(row, "core") == pytest.approx(60 * row["config"]["core_minutes"], rel=0.01)
    benchmark = json.loads((RESULTS / "benchmark" / "training_res2former.json").read_text())
    cost = benchmark["decoders"]["res2former"]
    reached = 1e9 * cost["training"]["precisions"]["bf16-mixed"]["gflops"] / benchmark["threads"]
    assert (full.macs, full.operations) == (pytest.approx(cost["macs"], rel=0.01), pytest.approx(reached, rel=0.01))


def test_a_rate_is_of_the_most_similar_network() -> None:
    small, full = (one.operations for one in RATES["core"] if one.decoder == "res2former")
    assert (rate("core", "res2former", 6e10), rate("core", "res2former", 5e8)) == (full, small)
    assert small < rate("core", "gap_net", 1e9) < full  # the median of what is as small
    assert rate("h100", "res2former", 861e9) == RATES["h100"][0].operations  # nothing is within ALIKE times
    assert 861e9 / RATES["h100"][0].macs > ALIKE


def test_memory_is_what_was_counted_of_a_step() -> None:
    """Res2former at 256 x 256, one clip, float32."""
    (measured,) = (
        row for row in json.loads((RESULTS / "training-memory.json").read_text())["rows"] if "is" in str(row)
    )
    words = ["decoder=res2former", "size=[256,256]", "batch_size=1", "precision=32", "trainer.accelerator=cpu"]
    plan = row_plan("res2former", plain(compose("train", words).cfg), "core")
    assert plan.memory / 2**30 == pytest.approx(measured["tensors_gib"], rel=WITHIN)


def test_the_command(ran: Callable[..., str], refused: Callable[..., str], tmp_path: Path) -> None:
    """Two cores take half of the time, and nothing is written."""
    words = ["dry_run=true", "only=[rbw_sr_1bit_e2e_cnn]", "seeds=2", "steps=4000", "row_scale=cpu"]
    hours = []
    for devices in ("1xcore", "2xcore"):
        printed = ran("tables_rows", *words, f"devices={devices}")
        (line,) = (line.split() for line in printed.splitlines() if "rbw_sr" in line)
        assert line[:6] == ["rbw_sr", "e2e_cnn", "1", "2", "4,000", "16,000"] and "2 trainings" in printed
        hours.append(float(line[6]))
    assert hours[0] == pytest.approx(4000 * 0.215 / 3600, rel=0.02) == pytest.approx(2 * hours[1], rel=0.01)
    assert "devices=8xfast: expected a number and a kind" in refused("tables_rows", *words, "devices=8xfast")
    assert not list(tmp_path.iterdir())
