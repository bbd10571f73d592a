"""The system's loss over the stages of a decoder, and its learning rate."""

from __future__ import annotations

import math
from datetime import timedelta

import lightning as L
import pytest
import torch
from lightning.pytorch.callbacks import Timer

from sci_lightning.decoder import E2ECNN, GAPNet
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import LearnedStructural
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput
from sci_lightning.training.system import System

pytestmark = pytest.mark.filterwarnings("ignore:You are trying to `self.log")  # a step without a trainer


@pytest.fixture
def encoder() -> Encoder:
    return Encoder(LearnedStructural(bits=2, frames=4, size=(16, 16)), ClipQuantise(bit_depth=8))


def test_loss_is_of_the_last_stages(encoder: Encoder) -> None:
    decoder, video = GAPNet(4, 3, (2, 2, 2)), torch.rand(2, 4, 16, 16)
    stages = decoder.stages(encoder(video), encoder.mask())
    rmse = [(stage - video).square().mean().sqrt() for stage in stages]
    for weights, expected in (((1.0,), rmse[2]), ((0.5, 0.25, 1.0), 0.5 * rmse[0] + 0.25 * rmse[1] + rmse[2])):
        system = System(encoder, decoder, loss="rmse", stage_weights=weights)
        torch.testing.assert_close(system.training_step(video, 0), expected)


def test_the_loss_of_frames_weighs_each_by_its_own_root(encoder: Encoder) -> None:
    decoder, video = GAPNet(4, 1, (2, 2, 2)), torch.rand(2, 4, 16, 16)
    error = decoder(encoder(video), encoder.mask()) - video
    frames = [frame.square().mean().sqrt() for clip in error for frame in clip]
    result = System(encoder, decoder, loss="frame_rmse").training_step(video, 0)
    torch.testing.assert_close(result, torch.stack(frames).mean())


def test_every_weighted_stage_is_trained(encoder: Encoder) -> None:
    video = torch.rand(1, 4, 16, 16)
    for weights in ((1.0,), (0.5, 1.0)):
        decoder = GAPNet(4, 2, (2, 2, 2))
        for unet in decoder.children():
            torch.nn.init.zeros_(unet.conv_last.weight)  # type: ignore[union-attr, arg-type]
        decoder.unet2.requires_grad_(False)  # what is left is the first stage's own loss and its way through the second
        System(encoder, decoder, stage_weights=weights).training_step(video, 0).backward()
        assert decoder.unet1.conv_last.bias.grad.abs().sum() > 0  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("seconds", "fraction"), [(None, 0.5), (10.0, 0.5), (75.0, (1 - math.sqrt(0.5)) / 2), (100.0, 0.0), (130.0, 0.0)]
)
def test_learning_rate_falls_with_the_steps_or_the_time(
    encoder: Encoder, seconds: float | None, fraction: float
) -> None:
    system = System(encoder, GAPNet(4, 1, (2, 2, 2)), lr=1e-3, final_lr=1e-5)
    timer = Timer(duration=timedelta(seconds=100))
    timer.load_state_dict({"time_elapsed": {"train": seconds}})
    callbacks = [] if seconds is None else [timer]
    system.trainer = L.Trainer(
        max_steps=4, max_epochs=-1, callbacks=callbacks, accelerator="cpu", logger=False, enable_checkpointing=False
    )
    optimisers = system.configure_optimizers()
    schedule = optimisers["lr_scheduler"]["scheduler"]
    for _ in range(2):
        optimisers["optimizer"].step()
        schedule.step()
    assert schedule.get_last_lr()[0] == pytest.approx(1e-5 + fraction * (1e-3 - 1e-5))


def test_weights_that_do_not_fit(encoder: Encoder) -> None:
    for weights in ((), (1.0, 0.0), (-1.0,)):
        with pytest.raises(BadInput, match="one or more positive numbers"):
            System(encoder, E2ECNN(4, 4, 1), stage_weights=weights)
    system = System(encoder, E2ECNN(4, 4, 1), stage_weights=(0.5, 1.0))
    with pytest.raises(BadInput, match=r"2 weights.* 1 stage"):
        system.training_step(torch.rand(1, 4, 16, 16), 0)
