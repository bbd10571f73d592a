"""What a training step takes beside encoder and decoder: the loss, clipped gradients, a seed, and what is logged.

Losses compare a reconstructed video ``(N, T, H, W)`` with the true one; ``system.loss=`` names them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import lightning as L
import numpy as np
import torch

from sci_lightning.errors import BadInput, TrainingDiverged


def mse(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return the mean squared error (the paper's Eq. 6)."""
    return (estimate - truth).square().mean()


def rmse(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return the root of the mean squared error (what the released training code minimises)."""
    return mse(estimate, truth).sqrt()


def frame_rmse(estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return the mean over frames of the root of each one's mean squared error: as PSNR does, it weighs easy frames."""
    return (estimate - truth).square().mean((-2, -1)).sqrt().mean()


LOSSES: dict[str, Callable[[torch.Tensor, torch.Tensor], torch.Tensor]] = {
    "mse": mse,
    "rmse": rmse,
    "frame_rmse": frame_rmse,
}


class StageLoss:
    """The weighted sum of the losses of a decoder's last stages.

    Args:
        name: ``mse``, ``rmse`` or ``frame_rmse``.
        weights: of the last stages, in their order.

    Raises:
        BadInput: no such loss, no weights or one that is not positive; when called, more weights than stages.
    """

    def __init__(self, name: str, weights: Sequence[float]) -> None:
        if name not in LOSSES:
            raise BadInput(f"system.loss={name}: no such loss; choose one of {', '.join(LOSSES)}")
        if not weights or min(weights) <= 0:
            raise BadInput(f"system.stage_weights={list(weights)}: give one or more positive numbers, as [0.5,1]")
        self.of_video, self.weights = LOSSES[name], tuple(weights)

    def __call__(self, stages: Sequence[torch.Tensor], video: torch.Tensor) -> torch.Tensor:
        """Return the loss of estimates ``(N, T, h, w)`` from first to last against the video."""
        if len(self.weights) > len(stages):
            raise BadInput(
                f"system.stage_weights={list(self.weights)}: {len(self.weights)} weights, but this decoder estimates "
                f"in {len(stages)} stage{'s' * (len(stages) > 1)}; give at most as many"
            )
        losses = [self.of_video(stage, video) for stage in stages[-len(self.weights) :]]
        return torch.stack([weight * loss for weight, loss in zip(self.weights, losses, strict=True)]).sum()


def clip_finite_gradients(
    module: L.LightningModule,
    optimizer: torch.optim.Optimizer,
    loss: torch.Tensor,
    limit: float | None,
    algorithm: str | None,
    advice: str,
) -> torch.Tensor:
    """Clip all gradients, and return their norm before; the norm is computed once, the device is waited for once.

    Args:
        module: in training.
        optimizer: of the parameters.
        loss: of the batch.
        limit, algorithm: the trainer's ``gradient_clip_val`` and ``gradient_clip_algorithm``.
        advice: what to do about gradients that are not finite.

    Raises:
        TrainingDiverged: the loss or the norm is not finite.
    """
    trainer = module.trainer
    parameters = [p for group in optimizer.param_groups for p in group["params"] if p.grad is not None]
    norm = torch.nn.utils.get_total_norm([p.grad for p in parameters if p.grad is not None])
    # under float16 scaling an overflow is expected: the scaler skips that step by itself
    if trainer.precision != "16-mixed" and not torch.isfinite(norm + loss):
        value = float(loss)
        what = f"the gradient's norm became {float(norm)}" if math.isfinite(value) else f"the loss became {value}"
        raise TrainingDiverged(
            f"{what} at epoch {trainer.current_epoch}, batch {trainer.fit_loop.batch_idx} (step {trainer.global_step}):"
            f" stopped; {advice} or check the data; the checkpoints hold the last good (finite) state"
        )
    if algorithm == "value":
        module.clip_gradients(optimizer, limit, algorithm)
    elif limit:
        torch.nn.utils.clip_grads_with_norm_(parameters, limit, norm)
    return norm


def is_logged(trainer: L.Trainer) -> bool:
    """Return whether a step's numbers are logged: those of every so many steps, and at both ends of an epoch."""
    loop, every = trainer.fit_loop.epoch_loop, trainer.log_every_n_steps  # type: ignore[attr-defined]  # not declared
    due = every > 0 and (trainer.global_step + 1) % every == 0
    return due or loop.batch_progress.is_last_batch or loop.batch_idx == 0


def seed_step(seed: int, step: int, process: int, device: torch.device, testing: bool = False) -> None:
    """Seed torch for a step, so that noise and windows do not depend on what ran before: a resumed run repeats them."""
    # torch's generator of a CPU keeps 32 bits of a seed: all parts must be mixed into each bit
    parts = np.random.SeedSequence((seed, int(testing), step, process))
    mixed = int(parts.generate_state(1, np.uint64)[0])
    if device.type == "cpu":
        torch.default_generator.manual_seed(mixed)  # torch.manual_seed prints a stack for every other kind of device
    else:
        torch.manual_seed(mixed)
