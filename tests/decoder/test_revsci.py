"""Training RevSCI without stored activations: the same gradients, and memory that does not grow with depth."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch.multiprocessing.reductions import StorageWeakRef
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from sci_lightning.decoder import Decoder, RevSCI


def gradients(decoder: Decoder, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
    """Of the measurement, the mask and every parameter."""
    inputs = [measurement.clone().requires_grad_(), mask.clone().requires_grad_()]
    loss = (decoder(*inputs) - 0.5).square().mean()
    return list(torch.autograd.grad(loss, [*inputs, *decoder.parameters()]))


@pytest.mark.parametrize(("blocks", "channels"), [(50, 16), (6, 64)])
def test_the_same_gradients(blocks: int, channels: int) -> None:
    stored, computed = RevSCI(blocks, channels), RevSCI(blocks, channels, reversible=True)
    computed.load_state_dict(stored.state_dict())
    measurement, mask = torch.rand(2, 21, 18), torch.rand(5, 21, 18)
    assert torch.equal(stored(measurement, mask), computed(measurement, mask))
    expected, outcome = (gradients(decoder, measurement, mask) for decoder in (stored, computed))
    for reference, gradient in zip(expected, outcome, strict=True):
        torch.testing.assert_close(gradient, reference, rtol=0, atol=1e-5 * float(reference.abs().max()))


def test_the_same_gradients_in_mixed_precision() -> None:
    """The halves are computed again in the precision in which they were made."""
    decoder = RevSCI(4, 16, reversible=True)
    measurement, mask = torch.rand(1, 16, 16), torch.rand(4, 16, 16)
    reference = gradients(decoder, measurement, mask)
    with torch.autocast("cpu", torch.bfloat16):
        loss = (decoder(measurement, mask) - 0.5).square().mean()
    mixed = torch.autograd.grad(loss, list(decoder.parameters()))
    for expected, outcome in zip(reference[2:], mixed, strict=True):
        assert outcome.dtype == torch.float32
        assert (outcome - expected).norm() < 0.1 * expected.norm()


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


def test_memory_does_not_grow_with_depth() -> None:
    def measured(blocks: int, reversible: bool) -> int:
        """Of a training step, without the gradients of the parameters, which stay."""
        decoder = RevSCI(blocks, 16, reversible)
        with Peak() as peak:
            decoder(torch.rand(1, 32, 32), torch.rand(8, 32, 32)).square().mean().backward()
        return peak.bytes - sum(4 * parameter.numel() for parameter in decoder.parameters())

    feature_map = 16 * 8 * 16 * 16 * 4  # bytes
    assert measured(20, True) - measured(4, True) < feature_map
    assert measured(20, False) - measured(4, False) > 16 * 2 * feature_map  # so the measure does see activations
