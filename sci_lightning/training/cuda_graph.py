"""The decoder's part of a training step on a GPU, recorded once and replayed: small networks wait for launches."""

from __future__ import annotations

import warnings
from typing import Any

import torch
from torch import nn

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.errors import BadInput


def check_graphed(batches_per_step: int, processes: int) -> None:
    """Check that a training can replay its steps; raises BadInput where gradients of several calls would be added."""
    if batches_per_step > 1 or processes > 1:
        raise BadInput(
            f"system.cuda_graph=true with trainer.accumulate_grad_batches={batches_per_step} on {processes} processes: "
            "a replay overwrites the gradients of the one before it; give one of each, or system.cuda_graph=false"
        )


class GraphedStages:
    """A decoder's stages with gradients, as CUDA graphs of the forward and of the backward pass.

    The first call on a GPU records both; further calls of the same shapes replay them. They launch the same kernels,
    without Python between them. Whatever cannot be replayed (another shape, a CPU) is computed as usual. Estimates
    stand in memory that the next call overwrites; so do gradients, which therefore cannot be accumulated over batches.

    Args:
        decoder: in training mode while this is called.

    Source: ``torch.cuda.make_graphed_callables``.
    """

    def __init__(self, decoder: Decoder) -> None:
        self._stages = _Stages(decoder)
        self._recorded: Any = None
        self._inputs: tuple[Any, ...] = ()

    def __call__(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        """Return what :meth:`~sci_lightning.decoder.Decoder.stages` returns.

        Raises:
            BadInput: the decoder cannot be recorded, for instance because it waits for the GPU within a step.
        """
        inputs = tuple((value.shape, value.requires_grad, value.device) for value in (measurement, mask))
        if self._recorded is None and measurement.device.type == "cuda" and torch.is_grad_enabled():
            self._record(measurement, mask)
            self._inputs = inputs
        graphed = inputs == self._inputs and torch.is_grad_enabled()
        return list((self._recorded if graphed else self._stages)(measurement, mask))

    def _record(self, *inputs: torch.Tensor) -> None:
        samples = tuple(value.detach().clone().requires_grad_(value.requires_grad) for value in inputs)
        precision = torch.get_autocast_dtype("cuda")
        enabled = torch.is_autocast_enabled("cuda")
        # recorded on a stream of its own, as PyTorch advises; autograd waits for it once a step, and says so once
        warnings.filterwarnings("ignore", message="The AccumulateGrad node's stream does not match")
        try:
            # without the cache: a replay must cast the weights as they are then
            with torch.autocast("cuda", precision, enabled=enabled, cache_enabled=False):
                stages = _Stages(self._stages.decoder)  # another one: recording replaces its forward
                self._recorded = torch.cuda.make_graphed_callables(stages, samples, allow_unused_input=True)
        except RuntimeError as error:
            name = type(self._stages.decoder).__name__
            raise BadInput(
                f"system.cuda_graph=true: a step of {name} cannot be recorded as a CUDA graph "
                f"({str(error).splitlines()[0]}); give false"
            ) from error


class _Stages(nn.Module):
    """The stages of a decoder as the call of a module, as PyTorch's recorder takes them."""

    def __init__(self, decoder: Decoder) -> None:
        super().__init__()
        self.decoder = decoder

    def forward(self, measurement: torch.Tensor, mask: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return tuple(self.decoder.stages(measurement, mask))
