"""Gradients of a step, checked and clipped; and the seed of what is random in it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

from sci_lightning.errors import TrainingDiverged


def gradient_norm(
    parameters: Sequence[torch.nn.Parameter], loss: torch.Tensor, may_overflow: bool, advice: str
) -> torch.Tensor:
    """Return the norm of all gradients; the device is waited for once.

    Args:
        parameters: that have gradients.
        loss: of the batch.
        may_overflow: under float16 scaling an overflow is expected: the scaler skips that step by itself.
        advice: the end of the message, where it happened and what to do.

    Raises:
        TrainingDiverged: the loss or the norm is not finite.
    """
    norm = torch.nn.utils.get_total_norm([p.grad for p in parameters if p.grad is not None])
    if not may_overflow and not torch.isfinite(norm + loss):
        value = float(loss)
        what = f"the gradient's norm became {float(norm)}" if math.isfinite(value) else f"the loss became {value}"
        raise TrainingDiverged(f"{what} {advice}")
    return norm


def seed_step(seed: int, step: int, process: int, device: torch.device, testing: bool = False) -> None:
    """Seed torch for a step, so that noise and windows do not depend on what ran before: a resumed run repeats them."""
    # torch's generator of a CPU keeps 32 bits of a seed: all parts must be mixed into each bit
    parts = np.random.SeedSequence((seed, int(testing), step, process))
    mixed = int(parts.generate_state(1, np.uint64)[0])
    if device.type == "cpu":
        torch.default_generator.manual_seed(mixed)  # torch.manual_seed prints a stack for every other kind of device
    else:
        torch.manual_seed(mixed)
