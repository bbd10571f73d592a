"""What a machine reaches in each precision where nothing holds it up: a matrix product and a convolution."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch.nn import functional as F

from sci_lightning.runs.precision import DTYPES
from sci_lightning.studies.benchmark.timing import seconds_in_turns

CHANNELS, SIDE = 64, 256
"""Of the convolution: 3 x 3 from 64 to 64 channels on 256 x 256 pixels, channels last."""

CALLS = 5
"""Timed calls, of which the fastest counts: the machine's speed is what nothing disturbs."""


def machine_speed(
    precisions: Sequence[str], place: torch.device, product: int, training: bool = False
) -> dict[str, dict[str, float]]:
    """Return 10^9 operations a second by precision: ``product_gflops``, ``convolution_gflops``.

    Args:
        precisions: by Lightning's names; float32 is what ``32-true`` multiplies, bfloat16 ``bf16-mixed``.
        place: device.
        product: n of the n x n matrix product; 0: measure nothing.
        training: whether to measure a convolution with its gradients as well, ``convolution_training_gflops``.
    """
    if not product:
        return {}
    speeds: dict[str, dict[str, float]] = {}
    for precision in precisions:
        dtype = DTYPES[precision] or torch.float32
        one, other = torch.rand(2, product, product, device=place).to(dtype)
        image = torch.rand(1, CHANNELS, SIDE, SIDE, device=place).to(dtype, memory_format=torch.channels_last)
        weight = torch.rand(CHANNELS, CHANNELS, 3, 3, device=place).to(dtype, memory_format=torch.channels_last)
        flops = 2 * 9 * CHANNELS**2 * SIDE**2
        work = {
            "product_gflops": (2 * product**3, lambda one=one, other=other: one @ other),
            "convolution_gflops": (flops, lambda x=image, w=weight: F.conv2d(x, w, padding=1)),
        }
        if training:
            x, w = (torch.rand_like(value).requires_grad_() for value in (image, weight))
            work["convolution_training_gflops"] = (3 * flops, lambda x=x, w=w: _with_gradients(x, w))
        with torch.inference_mode(False), torch.set_grad_enabled(training):
            seconds = seconds_in_turns({name: call for name, (_, call) in work.items()}, place, 1, CALLS)
        speeds[precision] = {name: 1e-9 * count / min(seconds[name]) for name, (count, _) in work.items()}
    return speeds


def _with_gradients(x: torch.Tensor, weight: torch.Tensor) -> None:
    result = F.conv2d(x, weight, padding=1)
    torch.autograd.grad(result, (x, weight), torch.ones_like(result))
