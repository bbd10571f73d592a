"""What a training is going to take: steps, examples, hours, and what it says once its first steps are timed."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sci_lightning.data.loader import share_of_batch
from sci_lightning.errors import BadInput
from sci_lightning.training import step_cost
from sci_lightning.training import training_plan as plans
from sci_lightning.training.training_length import steps_between_validations
from sci_lightning.training.training_plan import TrainingPlan, duration, duration_line
from tests.conftest import ROOT

SMALL = ["decoder=e2e_cnn", "decoder.channels=4", "decoder.blocks=1", "trainer.accelerator=cpu"]


def test_the_paper_scale_is_the_published_one(ran: Callable[..., str], tmp_path: Path) -> None:
    """100 epochs of 24,500 clips in batches of 16, float32, without DAVIS at hand; nothing is left behind."""
    printed = ran("train", "scale=paper", "encoder=lsw_sr", *SMALL, "dry_run=true")
    steps, step, hours = printed.splitlines()[:3]
    assert re.findall(r"[\d,]*\d", steps) == ["153,100", "16", "100", "24,500", "2,449,600"]
    assert "32-true" in step and re.search(r"about .* (hours|days)", hours)
    assert not list(tmp_path.iterdir())


def test_a_plan_with_a_limit_on_time(ran: Callable[..., str]) -> None:
    printed = ran("train", "scale=cpu", *SMALL, "core_minutes=0.5", "dry_run=true")
    assert "steps of 4 clips in 30 seconds" in printed
    assert "ends after 30 seconds of processor time" in printed


def test_a_plan_with_a_limit_on_the_duration(ran: Callable[..., str]) -> None:
    printed = ran("train", "scale=cpu", *SMALL, "trainer.max_time=00:00:00:20", "dry_run=true")
    assert "steps of 4 clips in 20 seconds" in printed and "ends after 20 seconds\n" in printed


@pytest.mark.parametrize(("limit", "steps"), [("10", "10 steps"), ("0.1", "33 steps"), ("1.0", "333 steps")])
def test_a_plan_with_fewer_batches(limit: str, steps: str, ran: Callable[..., str]) -> None:
    words = (*SMALL, "size=[32,32]", "batch_size=3", "trainer.max_epochs=1", f"+trainer.limit_train_batches={limit}")
    assert ran("train", *words, "dry_run=true").startswith(steps)


def test_a_plan_without_batches(refused: Callable[..., str]) -> None:
    words = (*SMALL, "size=[32,32]", "batch_size=300", "+trainer.limit_train_batches=0.1")
    assert "limit_train_batches=0.1: leaves no batch of 3" in refused("train", *words, "dry_run=true")


def test_a_plan_counts_the_clips_of_the_data(ran: Callable[..., str], refused: Callable[..., str]) -> None:
    printed = ran("train", *SMALL, "size=[32,32]", "batch_size=3", "trainer.max_epochs=2", "dry_run=true")
    assert re.findall(r"[\d,]*\d", printed)[:5] == ["666", "3", "2", "1,000", "1,998"]
    assert re.search(r"data\.root .*data\.clips_per_epoch=", refused("train", "data=davis", "dry_run=true"))
    assert "no whole batch" in refused("train", *SMALL, "batch_size=2000", "dry_run=true")


def test_a_plan_counts_validations_and_names_the_clips_kept_for_them(
    ran: Callable[..., str], refused: Callable[..., str], tmp_path: Path
) -> None:
    """After short epochs most of the time is theirs; a folder of one clip is refused as the training refuses it."""
    for folder, count in (("one", 1), ("five", 5)):
        (tmp_path / folder).mkdir()
        for number in range(count):
            np.savez(tmp_path / folder / f"clip{number}.npz", np.zeros((80, 40, 40), np.uint8))
    words = (*SMALL, "size=[32,32]", "data=folder", "data.clips_per_epoch=1", "trainer.max_epochs=300")
    words += ("decoder.channels=2", "crop=[16,16]", "data.store=store")
    printed = ran("train", *words, "data.root=five", "dry_run=true")
    assert re.search(r"300 validations and the test take about .* more; .*clips_per_epoch", printed)
    assert re.search(r"clip\d.npz, 1 of 5 clips; data.val_root=FOLDER names others", printed)
    named = ran("train", *words, "data.root=five", "data.val_root=one", "dry_run=true")
    assert "kept for" not in named
    never = ran("train", *words, "data.root=five", "+trainer.limit_val_batches=0", "dry_run=true")
    assert "less often" not in never
    for dry_run in ("true", "false"):
        assert "single clip" in refused("train", *words, "data.root=one", f"dry_run={dry_run}")


@pytest.mark.parametrize(
    ("trainer", "steps"),
    [
        ({}, 10),
        ({"check_val_every_n_epoch": 3}, 30),
        ({"val_check_interval": 0.5}, 5),
        ({"val_check_interval": 40, "accumulate_grad_batches": 2}, 20),
    ],
)
def test_steps_between_validations(trainer: dict[str, Any], steps: float) -> None:
    assert steps_between_validations(trainer, 10) == steps


def test_a_limit_on_the_duration_includes_validations() -> None:
    plan = TrainingPlan(100, 10, 1000, 1, 0.1, "cpu", most_seconds=20, validation_steps=10, validation_seconds=1.0)
    assert plan.expected_steps == 100


def test_a_limit_on_the_duration_as_a_scale_states_it() -> None:
    """``scale=gpu30`` has an object in place of a text."""
    assert plans.most_seconds({"max_time": {"_target_": "datetime.timedelta", "minutes": 25}}) == 1500
    assert plans.most_seconds({"max_time": None}) is None


def test_the_batch_is_of_all_processes() -> None:
    assert [share_of_batch(16, processes) for processes in (1, 2, 8, 16)] == [16, 8, 2, 1]
    assert share_of_batch(1, 4) == 1
    with pytest.raises(BadInput, match=r"batch_size=16 .* multiple of 3"):
        share_of_batch(16, 3)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(50, "50 seconds"), (170, "3 minutes"), (2700, "45 minutes"), (11600, "3.2 hours"), (170.4 * 86400, "170 days")],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_the_duration_in_a_sentence() -> None:
    assert "about 170 days" in duration_line(170 * 86400)
    assert "about 2.0 hours" in duration_line(7200)
    assert "ends after 45 minutes of processor time" in duration_line(10**6, 45)
    assert "5 minutes on this machine" in duration_line(300, 45)
    assert duration_line(7200, 45, 600).endswith("ends after 10 minutes")
    assert "ends after 45 minutes of processor time" in duration_line(7200, 45, 6000)
    assert TrainingPlan(100, 100, 100, 1, 0.1, "cpu").lines()[0].startswith("100 steps of 1 clip: 1 epoch of 100 clips")


def test_above_a_day_it_says_what_makes_sense(ran: Callable[..., str], monkeypatch: pytest.MonkeyPatch) -> None:
    cost = plans.StepCost(100.0, 1.0, 1.0, 4e9, 2e8)
    monkeypatch.setattr(plans, "measured_step", lambda *_: cost)
    monkeypatch.setattr(plans, "free_memory", lambda _: 16e9)
    printed = ran("train", "decoder=res2former", "dry_run=true")
    assert "101 s" in printed and "GB" in printed and " days" in printed
    assert "experiment=quickstart decoder=res2former" in printed
    assert "quickstart" not in ran("train", "decoder=res2former", "trainer.max_steps=10", "dry_run=true")


def test_what_does_not_fit_into_memory_is_refused_with_what_does(
    refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plans, "measured_step", lambda *_: plans.StepCost(1.0, 0.0, 0.0, 4e9, 2e8))
    monkeypatch.setattr(plans, "free_memory", lambda _: 10e9)
    line = refused("train", "decoder=res2former", "batch_size=16")
    assert "batch_size=2 trainer.accumulate_grad_batches=8" in line and "64 GB" in line
    monkeypatch.setattr(plans, "free_memory", lambda _: 2e9)
    line = refused("train", "decoder=res2former")
    assert "'crop=[160,160]'" in line and "decoder.checkpoint=true" in line


def test_a_straight_line_over_the_pixels() -> None:
    assert step_cost._line([(256, 3.0), (512, 4.0), (1024, 6.0)], 65536) == pytest.approx((258.0, 2.0))
    assert step_cost._line([(256, 3.0)], 512) == (6.0, 0.0)
    assert step_cost._windows(24, 100)[0] == (16, 16) and step_cost._windows(24, 100)[-1] == (24, 100)


def test_a_plan_is_measured_without_lightning() -> None:
    """Which takes as long to load as the plan to be measured."""
    code = (
        "import sys; from sci_lightning.cli.composition import compose, plain; "
        "from sci_lightning.training.training_plan import training_plan; "
        f"plan = training_plan(plain(compose('train', {[*SMALL, 'size=[32,32]']!r}).cfg)); "
        "print(plan.step_seconds > 0, plan.memory > 1e7, 'lightning' in sys.modules, 'torch._dynamo' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == ["True", "True", "False", "False"]
