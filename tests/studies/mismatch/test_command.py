"""``python -m sci_lightning.mismatch``: records outlive interruptions, and bad input is one line."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sci_lightning.cli.commands.mismatch import list_decoders
from sci_lightning.studies.mismatch import protocol
from tests.conftest import ROOT
from tests.files.formats import check

NAME = "mismatch"
SMALL = [
    *("data=synthetic", "data.scenes_count=1", "data.snapshots_per_scene=1", "size=[32,32]", "frames=4"),
    *("decoder=linear", "cameras=[alone]", "scenarios=[mismatched,known]"),
    *(f"mismatch.{name}=null" for name in ("mask_shift", "mask_rotation", "mask_blur", "sync_offset", "duty_cycle")),
]
"""Two cameras: one with the gain, one with the black level."""


def test_records_are_kept_and_completed(
    ran: Callable[..., str], refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    run = protocol.Protocol.run

    def counted(self: Any, camera: Any, *rest: Any) -> Any:
        done.append(camera.name)
        return run(self, camera, *rest)

    monkeypatch.setattr(protocol.Protocol, "run", counted)
    text = ran(NAME, *SMALL, "out=a")
    assert "alone_gain, linear: II" in text and "gain alone (factor 1.05)" in text and len(done) == 2
    path = tmp_path / "a" / "cases" / "alone_gain.linear.json"
    record = json.loads(path.read_text())
    check("mismatch", record)
    assert set(record["scenarios"]) == {"mismatched", "known"} and "/" not in record["provenance"]["command"]

    assert ran(NAME, *SMALL, "out=a").count("done before") == 2 and len(done) == 2
    path.unlink()  # as after a kill before it was written
    assert ran(NAME, *SMALL, "out=a").count("done before") == 1 and done[2:] == ["alone_gain"]
    more = [word.replace("[mismatched", "[ideal,mismatched") for word in SMALL]
    assert "done before" not in ran(NAME, *more, "out=a")  # a scenario more: the others are kept
    kept = json.loads(path.read_text())
    assert list(kept["scenarios"]) == ["ideal", "mismatched", "known"]
    assert kept["scenarios"]["known"] == record["scenarios"]["known"]
    commands = kept["provenance"]["command"]  # some figures are of the first run, others of the second
    assert record["provenance"]["command"] in commands and "[ideal,mismatched" in commands
    line = refused(NAME, *SMALL, "out=a", "seed=1")  # other noise: another measurement, which does not replace this one
    assert re.search(r"alone_gain\.linear\.json: .*seed=0, now 1.* out=", line)
    assert json.loads(path.read_text()) == kept


def test_several_decoders(ran: Callable[..., str], tmp_path: Path) -> None:
    assert list_decoders(["decoder=gap_tv,linear", "decoder.x=1,2", "decoder=linear"]) == [
        *("decoder=gap_tv", "decoders=[gap_tv,linear]", "decoder.x=1,2", "decoder=linear"),
    ]
    words = [word for word in SMALL if not word.startswith("decoder=")]
    ran(
        NAME,
        *words,
        *list_decoders(["decoder=admm_tv,gap_tv"]),
        "decoder.iterations=[2]",
        "mismatch.gain=null",
        "out=a",
    )
    assert {path.name for path in (tmp_path / "a" / "cases").glob("[!.]*")} == {
        "alone_black_level.admm_tv.json",
        "alone_black_level.gap_tv.json",
    }


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("decoder=gap_vt", "no such decoder"),
        ("decoders=[linear,gap_vt]", "gap_vt"),
        ("decoder=e2e_cnn", "parameters to learn: train it first, and give +weights.e2e_cnn="),
        ("+weights.gap_tv=a.ckpt", "weights.gap_tv: decoder=linear does not name this decoder"),
        ("+weights.linear=absent.ckpt", "no such checkpoint"),
        ("scenarios=[ideal,oracle]", "scenarios=['ideal', 'oracle']: expected a list of ideal, ideal_noisy"),
        ("cameras=[mine]", "cameras: no 'mine'"),
        ("mismatch.gain.factor=-1", "gain.factor must be a number from 0.01"),
        ("+mismatch.ghost.fraction=0.1", "mismatch.ghost: the encoder has no such effect"),
        ("mask=mask.npy", "the scenes are (4, 32, 32)"),
        ("middle=[64,64]", "larger than the scenes"),
        ("bit_depth=4", "bit_depth must be a whole number from 8"),
        ("decoders=[]", "decoders=[]: expected"),
    ],
)
def test_bad_input(refused: Callable[..., str], override: str, message: str, tmp_path: Path) -> None:
    np.save(tmp_path / "mask.npy", np.ones((8, 32, 32)))
    words = [word for word in SMALL if word.split("=")[0] != override.split("=")[0]]
    assert message in refused(NAME, *words, override, "out=a")
    assert not (tmp_path / "a").exists()


def test_a_foreign_file_in_the_place_of_a_record(refused: Callable[..., str], tmp_path: Path) -> None:
    path = tmp_path / "a" / "cases" / "alone_gain.linear.json"
    path.parent.mkdir(parents=True)
    for content in ("{}", "[]", "7", '{"format": "sci-mismatch", "format_version": 2}'):
        path.write_text(content)
        assert "alone_gain.linear.json" in refused(NAME, *SMALL, "out=a")
        assert path.read_text() == content


@pytest.mark.slow
def test_a_killed_run_goes_on(command: Callable[..., Any], tmp_path: Path) -> None:
    words = [*SMALL, "decoder.noise=0.01", "out=a"]
    program = [sys.executable, "-m", f"sci_lightning.{NAME}", *words]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(program, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL)
    cases, deadline = tmp_path / "a" / "cases", time.monotonic() + 300
    while not list(cases.glob("[!.]*.json")) and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = {path.name: path.stat().st_mtime_ns for path in cases.glob("[!.]*.json")}
    assert kept
    done = command(NAME, *words)
    assert done.returncode == 0, done.stderr
    now = {path.name: path.stat().st_mtime_ns for path in cases.glob("[!.]*")}
    assert len(now) == 2 and kept.items() <= now.items()
