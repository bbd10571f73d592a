"""What was hidden, beside what was found."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.files.diagnosis_report import Estimate, Evidence, NamedEffect
from sci_lightning.files.json_file import read_json
from sci_lightning.virtual_camera import Session, VirtualCamera
from sci_lightning.virtual_camera.comparison import Report, compare, read_report, verdict
from sci_lightning.virtual_camera.hardware.effect import Value
from sci_lightning.virtual_camera.truth import HiddenEffect, Truth

STAGES = {"ghost": "optics", "gain": "sensor", "flicker": "exposure", "pattern_order": "modulator"}


def hidden(**effects: Mapping[str, Value]) -> tuple[HiddenEffect, ...]:
    return tuple(
        HiddenEffect(
            name=name,
            stage=STAGES[name],
            in_vocabulary=name != "ghost",
            parameters=values,
            units={key: "rad" if key == "phase" else "1" for key in values},
        )
        for name, values in effects.items()
    )


def report(
    unnamed: Sequence[str] = (), alternatives: Sequence[str] = (), **effects: Mapping[str, tuple[Value, float]]
) -> Report:
    reported = (
        NamedEffect(
            name=name,
            stage=STAGES.get(name, "sensor"),
            parameters={key: Estimate(value=value, std=std, unit="1") for key, (value, std) in values.items()},
            evidence=Evidence(),
            alternatives=alternatives,
            tell_apart="",
        )
        for name, values in effects.items()
    )
    return Report(tuple(reported), tuple(unnamed), 33.0, 1.01)


def answers(truth: tuple[HiddenEffect, ...], result: Report) -> dict[str, str]:
    return {f"{row.effect}.{row.parameter}": row.answer for row in compare(truth, result)}


def test_parameter_by_parameter() -> None:
    truth = hidden(
        gain={"factor": 1.1},
        flicker={"phase": 3.1},
        pattern_order={"offset": 2},
        ghost={"fraction": 0.1, "dx": 5.0, "dy": 5.0},
    )
    result = report(
        gain={"factor": (1.1196, 0.0101)},
        flicker={"phase": (3.15 - 2 * math.pi, 0.03)},
        pattern_order={"offset": (3, 0.0)},
        vignetting={"strength": (0.2, 0.01)},
    )
    assert answers(truth, result) == {
        "gain.factor": "within 95 %",
        "flicker.phase": "within 95 %",
        "pattern_order.offset": "wrong",
        "ghost.fraction": "not found",
        "ghost.dx": "not found",
        "ghost.dy": "not found",
        "vignetting.strength": "not hidden",
    }
    brighter = hidden(gain={"factor": 1.1})
    assert answers(brighter, report(gain={"factor": (1.1197, 0.01)})) == {"gain.factor": "outside 95 %"}
    assert answers(brighter, report(gain={"factor": (1.1195, 0.01)})) == {"gain.factor": "within 95 %"}


@pytest.mark.parametrize(
    ("truth", "result", "sentence"),
    [
        ((), report(), "nothing was hidden, and nothing was named"),
        ((), report(gain={}), "nothing was hidden: a false alarm"),
        ((), report(unnamed=["optics"]), "nothing was hidden: a false alarm"),
        (hidden(gain={}), report(gain={}), "every name is right"),
        (hidden(gain={}), report(gain={}, unnamed=["optics"]), "every name is right, but something is left unnamed"),
        (hidden(gain={}), report(), "missed: gain"),
        (hidden(gain={}), report(prnu={}), "missed: gain; not hidden: prnu"),
        (
            hidden(gain={}),
            report(prnu={}, alternatives=["gain"]),
            "missed: gain; not hidden: prnu; among the alternatives: gain",
        ),
        (hidden(ghost={}), report(unnamed=["optics"]), "ghost has no name in the vocabulary; the stage is right"),
        (hidden(ghost={}), report(unnamed=["sensor"]), "missed: ghost"),
    ],
)
def test_sentence(truth: tuple[HiddenEffect, ...], result: Report, sentence: str) -> None:
    assert verdict(truth, result) == sentence


def report_file(**effects: Mapping[str, tuple[Value, float]]) -> dict[str, Any]:
    """A ``report.json``."""
    misfit = {"rmse_dn": 1.0, "nll": 1.0, "pixels": 100, "chi2_limit": 1.05, "by_kind": {}}
    split = {"held_out_captures": [], "fitted_captures": 1, "held_out_blocks": "", "held_out_fraction": 0.1}
    return {
        "format": "sci-diagnosis",
        "format_version": 1,
        "verdict": "explained",
        "effects": [
            {
                "name": name,
                "stage": STAGES[name],
                "parameters": {key: {"value": v, "std": s, "unit": "1"} for key, (v, s) in values.items()},
                "evidence": {},
                "alternatives": [],
                "tell_apart": "",
            }
            for name, values in effects.items()
        ],
        "uncertainty": "",
        "gap": {"before": {"chi2": 33.0, **misfit}, "after": {"chi2": 1.01, **misfit}},
        "unnamed": [],
        "where": {"before": [], "after": []},
        "noise": {"stated_by_the_file": []},
        "next_captures": [],
        "split": {**split, "held_out": True},
        "seed": 0,
        "sci_lightning": "0.1.0",
    }


def test_command(tmp_path: Path, command: Callable[..., CompletedProcess[str]]) -> None:
    VirtualCamera(Session(size=(16, 16), frames=2), {"gain": {"factor": 1.1}}).write(tmp_path / "a.h5")
    (tmp_path / "report.json").write_text(json.dumps(report_file(gain={"factor": (1.12, 0.02)})))
    done = command("virtual_camera.reveal", "a.truth.json", "report.json")
    assert done.returncode == 0, done.stderr
    assert "1.12 ± 0.02" in done.stdout and "within 95 %" in done.stdout
    assert "every name is right; held-out chi2 33 before, 1.01 after" in done.stdout

    for wrong, message in (
        (["a.truth.json", "none.json"], "none.json: no such file"),
        (["a.h5", "a.truth.json"], "a.h5: not readable as JSON"),
        (["a.truth.json"] * 2, "of another format, expected format sci-diagnosis 1 or 2 or 3"),
    ):
        done = command("virtual_camera.reveal", *wrong)
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert line.startswith("error: ") and message in line


GAIN: dict[str, Any] = {
    "name": "gain",
    "stage": "sensor",
    "in_vocabulary": True,
    "parameters": {"factor": 1.1},
    "units": {"factor": "1"},
}
TRUTH: dict[str, Any] = {
    "format": "sci-captures-truth",
    "format_version": 1,
    "effects": [GAIN],
    "noise": {"full_well_e": 1e4, "read_noise_dn": 0.8},
    "log_likelihood_gain": 100.0,
    "seed": 0,
    "session": {},
}


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("[" * 100_000, "not readable as JSON"),
        ({**TRUTH, "effects": 5}, r"t\.json: effects: "),
        ({**TRUTH, "effects": ["gain"]}, r"effects\.0: "),
        ({**TRUTH, "effects": [{**GAIN, "name": [1]}]}, r"effects\.0\.name: "),
        ({**TRUTH, "effects": [{**GAIN, "units": {}}]}, "one for every parameter"),
        ({**TRUTH, "effects": [{**GAIN, "parameters": {"factor": float("inf")}}]}, r"effects\.0\.parameters\.factor"),
        ({**TRUTH, "effects": [{**GAIN, "parameters": {"factor": float("nan")}}]}, r"effects\.0\.parameters\.factor"),
        ({**TRUTH, "effects": [{**GAIN, "parameters": {"factor": 10**400}}]}, r"effects\.0\.parameters\.factor"),
        (" " * 9_000_000, "larger than"),
    ],
)
def test_a_truth_of_unknown_origin(tmp_path: Path, content: object, line: str) -> None:
    path = tmp_path / "t.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(BadInput, match=line):
        read_json(path, Truth)


def test_a_report_of_unknown_origin(tmp_path: Path) -> None:
    right = report_file(gain={"factor": (1.1, 0.1)})
    gain = right["effects"][0]
    for wrong in (
        {**right, "gap": {}},
        {**right, "unnamed": [5]},
        {**right, "effects": [{**gain, "alternatives": None}]},
        {**right, "effects": [{**gain, "parameters": {"factor": {"value": [1], "std": 0.1, "unit": "1"}}}]},
        {**right, "effects": [{**gain, "parameters": {"factor": {"value": 1.0, "std": "x", "unit": "1"}}}]},
    ):
        (tmp_path / "r.json").write_text(json.dumps(wrong))
        with pytest.raises(BadInput, match=r"r\.json: "):
            read_report(tmp_path / "r.json")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadInput, match="not a readable file"):
        read_report(tmp_path / "pipe")
