"""Nothing of a run is lost: a refused command touches nothing, and a run that is gone on with appends to its logs."""

from __future__ import annotations

import csv
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from tests.training.small_training import TINY

Ran = Callable[..., str]
Command = Callable[..., subprocess.CompletedProcess[str]]
OWN = """
import torch

from sci_lightning.decoder import Decoder


class Mine(Decoder):
    def __init__(self, frames: int) -> None:
        super().__init__()
        self.net = torch.nn.Conv2d(frames, frames, 1)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.net(mask * measurement.unsqueeze(1))
"""


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def steps(run: Path) -> list[int]:
    with (run / "csv" / "metrics.csv").open(newline="") as file:
        return [int(row["step"]) for row in csv.DictReader(file) if row["train/loss"]]


def test_logs_are_kept_and_appended_to(ran: Ran, refused: Ran, tmp_path: Path) -> None:
    run, last = tmp_path / "RUN", "ckpt_path=RUN/checkpoints/last.ckpt"
    own = ["logger=[tensorboard,csv]", "callbacks.failed_training.stop=false", "metric=[psnr]", "data.scenes_count=1"]
    ran("train", *TINY, *own, "trainer.max_epochs=1", "out=RUN")
    before = content(run)
    for wrong, line in (("trainer.max_steps=2", "steps were made"), ("seed=4", "now it is 4"), ("bits=2", "bits")):
        assert line in refused("train", last, wrong, "logger=csv")
        assert content(run) == before, wrong
    refused("train", *TINY, *own, "out=RUN")
    assert content(run) == before

    shown = ran("train", last, "trainer.max_epochs=2")
    assert "tensorboard/" in shown and "csv/" in shown
    assert steps(run) == list(range(8))
    after = content(run)
    assert after["csv/metrics.csv"].count(b"\n") > before["csv/metrics.csv"].count(b"\n")
    boards = [name for name in before if "tfevents" in name]
    assert boards and all(after[name] == before[name] for name in boards)
    board = EventAccumulator(str((run / boards[0]).parent))
    board.Reload()
    assert [event.step for event in board.Scalars("train/loss")] == list(range(8))
    config = torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)["config"]
    assert config["callbacks"]["failed_training"]["stop"] is False and set(config["logger"]) == {"tensorboard", "csv"}


def test_every_printed_command_of_a_decoder_outside_the_package_works(command: Command, tmp_path: Path) -> None:
    (tmp_path / "my_decoders.py").write_text(OWN)
    (tmp_path / "own" / "decoder").mkdir(parents=True)
    (tmp_path / "own" / "decoder" / "mine.yaml").write_text("_target_: my_decoders.Mine\nframes: ${frames}\n")
    tiny = [word for word in TINY if not word.startswith("decoder")]

    def start(*words: str) -> subprocess.CompletedProcess[str]:
        assert words[:2] == (sys.executable, "-m") and words[2].startswith("sci_lightning.")
        return command(words[2].removeprefix("sci_lightning."), *words[3:])

    sender = "+callbacks.sender={_target_: tests.training.small_training.Sender, number: 15, moment: batch, step: 2}"
    more = ["hydra.searchpath=[file://own]", "decoder=mine", "metric=[psnr]", "data.scenes_count=1", "logger=csv"]
    stopped = start(sys.executable, "-m", "sci_lightning.train", *tiny, *more, sender, "out=RUN")
    assert stopped.returncode == 130, stopped.stderr
    words = shlex.split(stopped.stderr.rpartition("go on with:\n  ")[2])
    assert sender in words  # which stops this one at once, as it would have stopped the other one
    done = start(*[word for word in words if word != sender])
    assert done.returncode == 0, done.stderr
    assert steps(tmp_path / "RUN") == list(range(8)) and not (tmp_path / "RUN" / "tensorboard").exists()
    commands = [line.strip().partition(":")[2] for line in done.stdout.splitlines() if "sci_lightning.evaluate" in line]
    evaluated = start(*shlex.split(commands[0]))
    assert evaluated.returncode == 0, evaluated.stderr
