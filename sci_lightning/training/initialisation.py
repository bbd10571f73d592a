"""First weights of a decoder under which its result depends on its input."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from sci_lightning.data import Clips
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.layers.convolution import LastConv2d, LastConv3d
from sci_lightning.training.system import System

LAYERS = (nn.Linear, nn.Conv1d, nn.Conv2d, nn.Conv3d, nn.ConvTranspose2d, nn.ConvTranspose3d)
LAST_LAYERS = (LastConv2d, LastConv3d)
CLIPS = 4
"""Clips from which the variances are measured."""
TOLERANCE = 1.05
"""By how much the results of a layer that is used again may exceed the spread 1 before its weights shrink again."""


def start_at_unit_variance(system: System, clips: Clips) -> None:
    """Scale the first weights of a system's decoder on the first clips of its training.

    The clips are the same in every process, and so are the weights.

    Args:
        system: its encoder records the clips; its decoder is changed.
        clips: of the training, T x h x w.
    """
    video = torch.stack([clips[index] for index in range(min(CLIPS, len(clips)))])
    with torch.random.fork_rng([]), torch.no_grad():
        torch.manual_seed(system.seed)
        scale_to_unit_variance(system.decoder, *System.observe(system, video))  # not what a subclass observes


@torch.no_grad()
def scale_to_unit_variance(decoder: Decoder, measurement: torch.Tensor, mask: torch.Tensor) -> None:
    """Scale the weights of all layers but the last so that their results vary by 1 over positions and measurements.

    As torch draws weights, every convolution shrinks what its input tells apart, by two or three; its bias stays as it
    is. Behind the twenty convolutions of a plain network, nothing of the measurement is left: the result is a constant,
    and so small are the gradients that an hour of training learns little. Networks with short paths from input to
    result (E2E-CNN, Res2former, unfolding networks) do not need this.

    The variance is that of a channel, the mean over the channels. A layer that is used several times, as in a
    recurrence, ends with the largest spread at 1. The last layer is left alone: its result is the video.

    Args:
        decoder: changed.
        measurement, mask: what it decodes once, ``(N, H, W)`` and ``(N, T, H, W)`` or ``(T, H, W)``.

    Source: Mishkin and Matas, "All you need is a good init", ICLR 2016, without its orthogonal directions.
    """
    handles = [
        layer.register_forward_hook(_Scaling())
        for layer in decoder.modules()
        if isinstance(layer, LAYERS) and not isinstance(layer, LAST_LAYERS)
    ]
    try:
        decoder.stages(measurement, mask)
    finally:
        for handle in handles:
            handle.remove()


class _Scaling:
    """The forward hook of one layer."""

    def __init__(self) -> None:
        self.used = False

    def __call__(self, layer: Any, inputs: Any, result: torch.Tensor) -> torch.Tensor | None:
        """Return the result as the scaled weight gives it, or None where the weight is left as it is."""
        last = isinstance(layer, nn.Linear)  # where the channels are
        channels = result.movedim(-1 if last else 1, 0).flatten(1)
        spread = float(channels.float().var(1).mean().sqrt())
        used, self.used = self.used, True
        if not (TOLERANCE if used else 0) < spread < float("inf"):
            return None
        layer.weight /= spread
        if layer.bias is None:
            return result / spread
        bias = layer.bias if last else layer.bias.view(-1, *[1] * (result.ndim - 2))
        return (result - bias) / spread + bias
