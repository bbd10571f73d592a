"""A killed run goes on as if nothing had happened; a kill during a save leaves the previous checkpoint."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from sci_lightning.runs.checkpoint import load_file
from tests.end_to_end.killed_training import KILLED
from tests.training.small_training import TINY

# windows of a larger mask and sensor noise: everything that is random in a step
RUN = [
    *TINY,
    "size=[64,64]",
    "crop=[32,32]",
    "encoder.sensor.full_well=2000",
    "encoder.sensor.read_noise=1",
    "data.clips_per_epoch=40",
    "data.scenes_count=1",
    "workers=1",
    "callbacks.pictures=null",
    "callbacks.last.every_minutes=null",
    "callbacks.last.every_n_steps=1",
]


@pytest.mark.parametrize("precision", ["32-true", pytest.param("bf16-mixed", marks=pytest.mark.slow)])
def test_killed_in_the_middle_of_an_epoch(
    precision: str, command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    run = [*RUN, f"precision={precision}"]
    whole = command("train", *run, "out=whole")
    assert whole.returncode == 0, whole.stderr
    assert "precision: " in whole.stdout, whole.stdout

    last = tmp_path / "killed" / "checkpoints" / "last.ckpt"
    killed = command("train", *run, "out=killed", KILLED % "E2ECNN: 23")
    assert killed.returncode == -signal.SIGKILL
    assert torch.load(last, weights_only=True)["global_step"] == 23  # of 2 epochs of 20 steps: in the second

    resumed = command("train", *run, f"ckpt_path={last}", "out=resumed")
    assert resumed.returncode == 0, resumed.stderr
    one, other = (
        torch.load(tmp_path / name / "checkpoints" / "last.ckpt", weights_only=True) for name in ("whole", "resumed")
    )
    assert one["global_step"] == other["global_step"] == 40
    assert one["state_dict"].keys() == other["state_dict"].keys()
    for key, value in one["state_dict"].items():
        assert torch.equal(value, other["state_dict"][key]), key
    for key, value in one["optimizer_states"][0]["state"].items():
        assert all(torch.equal(v, other["optimizer_states"][0]["state"][key][k]) for k, v in value.items())


def test_killed_while_a_checkpoint_is_written(tmp_path: Path) -> None:
    path = tmp_path / "last.ckpt"
    script = f"""
import os, signal, torch
from sci_lightning.runs.checkpoint import write_checkpoint
first = {{"config": {{}}, "state_dict": {{"x": torch.ones(1000)}}}}
write_checkpoint({str(path)!r}, first)
whole = torch.save
def killed(content, file):
    whole(content, file)
    os.truncate(file, os.path.getsize(file) // 2)
    os.kill(os.getpid(), signal.SIGKILL)
torch.save = killed
write_checkpoint({str(path)!r}, first)
"""
    done = subprocess.run([sys.executable, "-c", script])
    assert done.returncode == -signal.SIGKILL
    assert torch.equal(load_file(path)["state_dict"]["x"], torch.ones(1000))
