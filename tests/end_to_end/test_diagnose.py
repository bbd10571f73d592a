"""``diagnose`` finds what is hidden in captures, writes an encoder to go on with, and refuses what it cannot use."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sci_lightning.virtual_camera import Session, VirtualCamera


@pytest.mark.parametrize(
    "hidden", [{}, pytest.param({"mask_shift": {"dx": 0.61, "dy": -0.35}}, marks=pytest.mark.slow)]
)
def test_diagnose(hidden: dict[str, dict[str, float]], tmp_path: Path, command: Callable[..., Any]) -> None:
    VirtualCamera(Session(size=(48, 48)), hidden).write(tmp_path / "a.h5", seed=3)
    command("diagnose", f"captures={tmp_path}/a.h5", f"out={tmp_path}/out")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["verdict"] == ("explained" if hidden else "consistent")
    assert {each["name"] for each in report["effects"]} == set(hidden)
    assert report["gap"]["after"]["chi2"] < 1.05
    assert not any(test["significant"] for test in report["where"]["after"])
    assert any(test["significant"] for test in report["where"]["before"]) == bool(hidden)
    assert "</html>" in (tmp_path / "out" / "report.html").read_text()
    assert {"residuals.png", "evidence.png", "encoder.yaml"} <= {path.name for path in (tmp_path / "out").iterdir()}


@pytest.mark.slow
def test_dashboard(tmp_path: Path, command: Callable[..., Any]) -> None:
    VirtualCamera(Session(size=(32, 32)), {"gain": {"factor": 0.9}}).write(tmp_path / "a.h5", seed=3)
    done = command(
        "diagnose", f"captures={tmp_path}/a.h5", f"out={tmp_path}/out", "search.max_effects=1", "logger=tensorboard"
    )
    assert "explained: The sensor's gain is 0." in done.stdout
    events = EventAccumulator(str(tmp_path / "out" / "tensorboard" / "diagnosis"))
    events.Reload()
    before, after = events.Scalars("chi2")
    assert before.value > 10 * after.value
    assert {"residuals", "evidence", "gap"} <= set(events.Tags()["images"])


def test_nothing_known_of_a_small_field(tmp_path: Path, refused: Callable[..., str]) -> None:
    VirtualCamera(Session(size=(16, 16))).write(tmp_path / "a.h5", seed=3)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["scene"][...] = np.nan
    assert "known scene" in refused("diagnose", f"captures={tmp_path}/a.h5", f"out={tmp_path}/out")


@pytest.mark.parametrize(("value", "word"), [(0, "black"), (255, "saturated")])
def test_nothing_to_see(value: int, word: str, tmp_path: Path, refused: Callable[..., str]) -> None:
    VirtualCamera(Session(size=(32, 32))).write(tmp_path / "a.h5", seed=3)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["measurement"][...] = value
    assert word in refused("diagnose", f"captures={tmp_path}/a.h5", f"out={tmp_path}/out")
    assert not (tmp_path / "out" / "report.json").exists()
