"""The gradients of a training step, and the memory that it takes."""

from __future__ import annotations

from typing import Any

import torch
from torch.multiprocessing.reductions import StorageWeakRef
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from sci_lightning.decoder import Decoder


def gradients(decoder: Decoder, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
    """Of the measurement, the mask and every parameter."""
    inputs = [measurement.clone().requires_grad_(), mask.clone().requires_grad_()]
    loss = (decoder(*inputs) - 0.5).square().mean()
    return list(torch.autograd.grad(loss, [*inputs, *decoder.parameters()]))


class Peak(TorchDispatchMode):
    """The most bytes that tensors made since the start have taken at a time."""

    def __init__(self) -> None:
        super().__init__()
        self.alive: dict[StorageWeakRef, int] = {}
        self.at_most = 0
        self.bytes = 0

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        result = function(*args, **(kwargs or {}))
        for tensor in tree_leaves(result):
            if isinstance(tensor, torch.Tensor):
                storage = tensor.untyped_storage()
                reference = StorageWeakRef(storage)
                self.at_most += storage.nbytes() - self.alive.get(reference, 0)
                self.alive[reference] = storage.nbytes()
        if self.at_most > self.bytes:  # only then can it be a new peak, and what is no longer alive has to be known
            self.alive = {storage: size for storage, size in self.alive.items() if not storage.expired()}
            self.at_most = sum(self.alive.values())
            self.bytes = max(self.bytes, self.at_most)
        return result
