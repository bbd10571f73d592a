"""What a training is going to take: steps, examples, hours, and what it says once its first steps are timed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from sci_lightning.data.loader import share_of_batch
from sci_lightning.errors import BadInput
from sci_lightning.training.callbacks import ExpectedTime
from sci_lightning.training.processor_time import ProcessorTime
from sci_lightning.training.training_plan import TrainingPlan, duration, duration_line
from tests.training.test_training_position import scenes, system_and_trainer

SMALL = ["decoder=e2e_cnn", "decoder.channels=4", "decoder.blocks=1", "trainer.accelerator=cpu"]


def test_the_paper_scale_is_the_published_one(ran: Callable[..., str], tmp_path: Path) -> None:
    """100 epochs of 24,500 clips in batches of 16, float32, without DAVIS at hand; nothing is left behind."""
    printed = ran("train", "scale=paper", "encoder=lsw_sr", *SMALL, "dry_run=true")
    steps, step, hours = printed.splitlines()
    assert steps == "153,100 steps of 16 clips: 100 epochs of 24,500 clips, 2,449,600 examples"
    assert "32-true" in step and hours.startswith("training takes about ") and "on this machine" in hours
    assert not list(tmp_path.iterdir())


def test_a_plan_with_a_limit_on_time(ran: Callable[..., str]) -> None:
    printed = ran("train", "scale=cpu", *SMALL, "core_minutes=0.5", "dry_run=true")
    assert "steps of 4 clips in 0.5 minutes of processor time, about: " in printed
    assert "training ends after 30 seconds of processor time" in printed


def test_a_plan_with_a_limit_on_the_duration(ran: Callable[..., str]) -> None:
    printed = ran("train", "scale=cpu", *SMALL, "trainer.max_time=00:00:00:20", "dry_run=true")
    assert "steps of 4 clips in 20 seconds, about: " in printed and "training ends after 20 seconds\n" in printed


@pytest.mark.parametrize(("limit", "steps"), [("10", "10 steps"), ("0.1", "33 steps"), ("1.0", "333 steps")])
def test_a_plan_with_fewer_batches(limit: str, steps: str, ran: Callable[..., str]) -> None:
    words = (*SMALL, "size=[32,32]", "batch_size=3", "trainer.max_epochs=1", f"+trainer.limit_train_batches={limit}")
    assert ran("train", *words, "dry_run=true").startswith(steps)


def test_a_plan_without_batches(refused: Callable[..., str]) -> None:
    words = (*SMALL, "size=[32,32]", "batch_size=300", "+trainer.limit_train_batches=0.1")
    assert "limit_train_batches=0.1: leaves no batch of 3" in refused("train", *words, "dry_run=true")


def test_a_plan_counts_the_clips_of_the_data(ran: Callable[..., str], refused: Callable[..., str]) -> None:
    printed = ran("train", *SMALL, "size=[32,32]", "batch_size=3", "trainer.max_epochs=2", "dry_run=true")
    assert printed.startswith("666 steps of 3 clips: 2 epochs of 1,000 clips, 1,998 examples")
    assert "data.root is missing: give it, or data.clips_per_epoch=" in refused("train", "data=davis", "dry_run=true")
    assert "no whole batch" in refused("train", *SMALL, "batch_size=2000", "dry_run=true")


def test_the_batch_is_of_all_processes() -> None:
    assert [share_of_batch(16, processes) for processes in (1, 2, 8, 16)] == [16, 8, 2, 1]
    assert share_of_batch(1, 4) == 1
    with pytest.raises(BadInput, match="batch_size=16 cannot be shared out to 3 processes: give a multiple of 3"):
        share_of_batch(16, 3)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(50, "50 seconds"), (170, "3 minutes"), (2700, "45 minutes"), (11600, "3.2 hours"), (170.4 * 86400, "170 days")],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_what_would_be_shorter() -> None:
    assert duration_line(170 * 86400) == (
        "training takes about 170 days on this machine; scale=cpu takes 45 minutes of one core"
    )
    assert duration_line(7200) == "training takes about 2.0 hours on this machine"
    assert duration_line(10**6, 45) == "training ends after 45 minutes of processor time"
    assert "5 minutes on this machine" in duration_line(300, 45)
    assert duration_line(7200, 45, 600) == "training ends after 10 minutes"
    assert duration_line(7200, 45, 6000) == "training ends after 45 minutes of processor time"
    assert TrainingPlan(100, 1, 100, 1, 0.1, "cpu").lines()[0].startswith("100 steps of 1 clip: 1 epoch of 100 clips")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("budget", [None, 0.5])
def test_a_training_says_how_long_it_takes(
    budget: float | None, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the second step on; validation is no step."""
    clock = iter(range(0, 100_000, 3600))
    monkeypatch.setattr("sci_lightning.training.callbacks.expected_time.time.perf_counter", lambda: float(next(clock)))
    callbacks = [ExpectedTime(after_seconds=7000), *([] if budget is None else [ProcessorTime(budget)])]
    system, trainer, clips = system_and_trainer(tmp_path, callbacks, max_epochs=20)
    trainer.fit(system, clips, scenes())
    lines = [line for line in capsys.readouterr().out.splitlines() if " a step: " in line]
    assert len(lines) == 1 and lines[0].startswith("3.6e+03 s a step: ")
    shorter = "training takes about 4.0 days on this machine; scale=cpu takes 45 minutes of one core"
    assert lines[0].endswith(shorter) if budget is None else "30 seconds of processor time" in lines[0]
