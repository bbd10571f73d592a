"""What was hidden, beside what was found."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, capture_session, write_captures
from sci_lightning.virtual_camera.answer_files import read_report, read_truth
from sci_lightning.virtual_camera.comparison import compare, verdict

GHOST = {"fraction": 0.1, "dx": 5.0, "dy": 5.0}


def truth(**hidden):
    names = {"ghost": False}
    stages = {"ghost": "optics", "gain": "sensor", "flicker": "exposure", "pattern_order": "modulator"}
    return {
        "effects": [
            {
                "name": name,
                "stage": stages[name],
                "in_vocabulary": names.get(name, True),
                "parameters": values,
                "units": {key: "rad" if key == "phase" else "1" for key in values},
            }
            for name, values in hidden.items()
        ]
    }


def report(unnamed=(), alternatives=(), **found):
    return {
        "format": "sci-diagnosis",
        "format_version": 1,
        "effects": [
            {
                "name": name,
                "parameters": {key: {"value": v, "std": s, "unit": "1"} for key, (v, s) in values.items()},
                "alternatives": list(alternatives),
            }
            for name, values in found.items()
        ],
        "unnamed": [{"stage": stage} for stage in unnamed],
        "gap": {"before": {"chi2": 33.0}, "after": {"chi2": 1.01}},
    }


def answers(hidden, found):
    return {f"{row.effect}.{row.parameter}": row.answer for row in compare(hidden, found)}


def test_parameter_by_parameter():
    hidden = truth(gain={"factor": 1.1}, flicker={"phase": 3.1}, pattern_order={"offset": 2}, ghost=GHOST)
    found = report(
        gain={"factor": (1.1196, 0.0101)},
        flicker={"phase": (3.15 - 2 * math.pi, 0.03)},
        pattern_order={"offset": (3, 0.0)},
        vignetting={"strength": (0.2, 0.01)},
    )
    assert answers(hidden, found) == {
        "gain.factor": "within 95 %",
        "flicker.phase": "within 95 %",
        "pattern_order.offset": "wrong",
        "ghost.fraction": "not found",
        "ghost.dx": "not found",
        "ghost.dy": "not found",
        "vignetting.strength": "not hidden",
    }
    told = truth(gain={"factor": 1.1})
    assert answers(told, report(gain={"factor": (1.1197, 0.01)})) == {"gain.factor": "outside 95 %"}
    assert answers(told, report(gain={"factor": (1.1195, 0.01)})) == {"gain.factor": "within 95 %"}


@pytest.mark.parametrize(
    ("hidden", "found", "sentence"),
    [
        ({}, report(), "nothing was hidden, and nothing was found"),
        ({}, report(gain={}), "nothing was hidden: a false alarm"),
        ({}, report(unnamed=["optics"]), "nothing was hidden: a false alarm"),
        ({"gain": {}}, report(gain={}), "every name is right"),
        ({"gain": {}}, report(gain={}, unnamed=["optics"]), "every name is right, but something is left unnamed"),
        ({"gain": {}}, report(), "missed: gain"),
        ({"gain": {}}, report(prnu={}), "missed: gain; not hidden: prnu"),
        (
            {"gain": {}},
            report(prnu={}, alternatives=["gain"]),
            "missed: gain; not hidden: prnu; among the alternatives: gain",
        ),
        ({"ghost": {}}, report(unnamed=["optics"]), "ghost has no name in the vocabulary; the stage is right"),
        ({"ghost": {}}, report(unnamed=["sensor"]), "missed: ghost"),
    ],
)
def test_sentence(hidden, found, sentence):
    assert verdict(truth(**hidden), found) == sentence


def reveal(*arguments):
    words = [sys.executable, "-m", "sci_lightning.virtual_camera.reveal", *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, env={**os.environ, "COLUMNS": "100"})


def test_command(tmp_path):
    path = write_captures(
        tmp_path / "a.h5", capture_session(Session(size=(16, 16), frames=2), {"gain": {"factor": 1.1}})
    )
    (tmp_path / "report.json").write_text(json.dumps(report(gain={"factor": (1.12, 0.02)})))
    done = reveal(path, tmp_path / "report.json")
    assert done.returncode == 0, done.stderr
    assert "1.12 ± 0.02" in done.stdout and "within 95 %" in done.stdout
    assert "every name is right; held-out chi2 33 before, 1.01 after" in done.stdout

    for wrong, message in (
        ([path, tmp_path / "none.json"], "none.json: no such file or directory; expected JSON of format sci-diagnosis"),
        ([tmp_path / "a.h5", path], "a.h5: not JSON"),
        ([path, path], "format 'sci-captures-truth', expected 'sci-diagnosis', format_version 1"),
    ):
        done = reveal(*wrong)
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert line.startswith("error: ") and message in line
    assert reveal().returncode == 2 and "TRUTH REPORT" in reveal("--help").stdout


TRUTH = {"format": "sci-captures-truth", "format_version": 1, **truth(gain={"factor": 1.1})}
GAIN = TRUTH["effects"][0]


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ("[" * 100_000, "nested too deeply"),
        ({**TRUTH, "effects": 5}, "effects: expected a list"),
        ({**TRUTH, "effects": ["gain"]}, r"effects\[0\]: expected an object"),
        ({**TRUTH, "effects": [{**GAIN, "name": [1]}]}, r"effects\[0\].name: expected a text"),
        ({**TRUTH, "effects": [{**GAIN, "units": {}}]}, "one for every parameter"),
        ({**TRUTH, "effects": [{**GAIN, "parameters": {"factor": float("inf")}}]}, "expected a finite number"),
        ({**TRUTH, "effects": [{**GAIN, "parameters": {"factor": 10**400}}]}, "expected a finite number"),
        ({**TRUTH, "effects": [GAIN] * 2000}, "at most 1000"),
        (" " * 9_000_000, "larger than"),
    ],
)
def test_a_truth_of_a_stranger(tmp_path, content, line):
    path = tmp_path / "t.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(BadInput, match=line):
        read_truth(path)


def test_a_report_of_a_stranger(tmp_path):
    right = report(gain={"factor": (1.1, 0.1)})
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
    with pytest.raises(BadInput, match="not a file"):
        read_report(tmp_path / "pipe")
