"""A training that collapsed warns, and ends with advice; one that learns is left alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from sci_lightning.decoder import Decoder
from sci_lightning.errors import TrainingFailed
from sci_lightning.training.callbacks import FailedTraining
from tests.training.small_training import BATCHES, scenes, system_and_trainer

pytestmark = pytest.mark.filterwarnings("ignore")


class Saturated(Decoder):
    """Ends in a tanh, as E2E-CNN does, which a large step drives to its end: a constant, without gradient."""

    def __init__(self) -> None:
        super().__init__()
        self.net = torch.nn.Conv2d(2, 2, 1)

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return torch.tanh(self.net(mask * measurement.unsqueeze(1)))


class Mean(Decoder):
    """The mean measurement, darker by an offset that is learned away slowly."""

    def __init__(self, offset: float) -> None:
        super().__init__()
        self.offset = torch.nn.Parameter(torch.tensor(offset))

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.operator(mask).mean_video(measurement) - self.offset.relu()


class Breaking(Mean):
    """The mean measurement, until a step after which every frame is far too bright."""

    def __init__(self, after: int, brightness: float) -> None:
        super().__init__(0.0)
        self.after, self.brightness, self.batches = after, brightness, 0

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        self.batches += self.training
        broken = self.training and self.batches > self.after
        return super().decode(measurement, mask) + self.brightness * broken


def fit(folder: Path, decoder: Decoder, watch: FailedTraining, lr: float, **options: Any) -> int:
    """Train with the callback; return the epochs that were begun."""
    options = {"max_epochs": 10, **options}
    system, trainer, clips = system_and_trainer(folder, [watch], decoder=decoder, lr=lr, **options)
    trainer.fit(system, clips, scenes())
    return trainer.global_step // BATCHES


def test_a_forced_collapse_warns_and_ends_with_advice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(TrainingFailed) as failure:
        fit(tmp_path, Saturated(), FailedTraining(after=0.1), lr=1000.0)
    line = str(failure.value)
    assert "less than the mean measurement (" in line and "stopped at step 10, after 20% of the training" in line
    assert "smaller system.lr (it is 1000)" in line and "callbacks.failed_training.stop=false" in line
    assert "\n" not in line and (tmp_path / "last.ckpt").is_file()
    (warning,) = capsys.readouterr().err.splitlines()
    assert warning.startswith("warning: validation reaches") and "after 10% of the training" in warning


def test_told_to_go_on_it_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert fit(tmp_path, Saturated(), FailedTraining(stop=False), lr=1000.0) == 10
    assert capsys.readouterr().err.count("warning:") == 1


def test_the_first_part_of_a_training_is_not_judged(tmp_path: Path) -> None:
    with pytest.raises(TrainingFailed, match="after 60% of the training"):
        fit(tmp_path, Saturated(), FailedTraining(after=0.5), lr=1000.0)


@pytest.mark.parametrize(("offset", "warnings"), [(-1.0, 0), (0.8, 1)])
def test_a_training_that_is_not_below_or_still_rises_is_not_ended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], offset: float, warnings: int
) -> None:
    assert fit(tmp_path, Mean(offset), FailedTraining(), lr=1e-2) == 10
    assert capsys.readouterr().err.count("warning:") == warnings


@pytest.mark.parametrize(("brightness", "warnings"), [(5.0, 1), (0.0, 0)])
def test_a_jump_of_the_loss_warns_once_before_the_next_validation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], brightness: float, warnings: int
) -> None:
    decoder, watch = Breaking(100, brightness), FailedTraining(every_n_steps=5)
    assert fit(tmp_path, decoder, watch, lr=1e-6, max_epochs=40) == 40
    told = capsys.readouterr().err.splitlines()
    assert len(told) == warnings
    for line in told:
        assert line.startswith("warning: step 1") and "the loss has risen from 0." in line
        assert "smaller system.lr" in line
