"""Training RevSCI without stored activations: the same gradients, and memory that does not grow with depth."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.decoder import RevSCI
from tests.decoder.gradients import Peak, gradients


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
