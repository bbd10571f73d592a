"""A step's gradients, checked and clipped; the seed of what is random in it; and whether its numbers are logged."""

from __future__ import annotations

import math

import lightning as L
import numpy as np
import torch

from sci_lightning.errors import TrainingDiverged


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
