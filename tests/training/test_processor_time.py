"""Processor time as a training's budget: what counts, and that a resumed training goes on counting."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import lightning as L
import pytest

from sci_lightning.errors import BadInput
from sci_lightning.training.learning_rates import ProcessorTime
from tests.training.small_training import scenes, system_and_trainer


class Clock(L.Callback):
    """A processor that a step keeps busy for 60 s, and a validation for an hour."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.rates: list[float] = []

    def on_train_batch_start(self, trainer: L.Trainer, *others: Any) -> None:
        self.now += 60
        self.rates.append(trainer.optimizers[0].param_groups[0]["lr"])

    def on_validation_batch_start(self, *others: Any) -> None:
        self.now += 3600


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, "process_time", lambda: clock.now)
    return clock


def fit(folder: Path, clock: Clock, minutes: float, resumed: bool = False) -> tuple[ProcessorTime, int]:
    budget = ProcessorTime(minutes)
    system, trainer, clips = system_and_trainer(folder, [clock, budget], every=1, max_epochs=100, max_steps=-1)
    trainer.fit(system, clips, scenes(), ckpt_path=str(folder / "last.ckpt") if resumed else None)
    return budget, trainer.global_step


@pytest.mark.filterwarnings("ignore")
def test_a_training_ends_when_its_time_is_spent(clock: Clock, tmp_path: Path) -> None:
    """Seven minutes are seven steps, over which the learning rate falls; validations after the fifth do not count."""
    budget, steps = fit(tmp_path, clock, 7)
    assert steps == 7 and budget.part_spent == 1
    assert clock.rates[0] == 1e-2 and all(
        rate > after for rate, after in zip(clock.rates, clock.rates[1:], strict=False)
    )
    assert clock.rates[-1] < 2e-3


@pytest.mark.filterwarnings("ignore")
def test_a_resumed_training_goes_on_counting(clock: Clock, tmp_path: Path) -> None:
    assert fit(tmp_path, clock, 3)[1] == 3
    clock.now += 10**6  # another process counts from another start
    budget, steps = fit(tmp_path, clock, 8, resumed=True)
    assert steps == 8 and budget.seconds == pytest.approx(480)
    assert fit(tmp_path, clock, 8, resumed=True)[1] == 8  # nothing is left


@pytest.mark.parametrize("seconds", [-1.0, float("nan"), True, "12"])
def test_a_time_that_is_none(seconds: Any) -> None:
    with pytest.raises(BadInput):
        ProcessorTime(1).load_state_dict({"seconds": seconds})
