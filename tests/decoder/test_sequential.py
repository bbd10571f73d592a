"""Activations computed again: the same gradients, on less memory."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from sci_lightning.decoder import Decoder, Res2former, STFormer
from sci_lightning.decoder.layers.sequential import computed_as_larger
from sci_lightning.decoder.tiling.memory import LiveBytes
from sci_lightning.runs.precision import mixed_precision
from tests.decoder.gradients import Peak, gradients

NETWORKS: dict[str, Callable[[bool], Decoder]] = {
    "res2former": lambda checkpoint: Res2former(16, (4, 4), checkpoint=checkpoint),
    "stformer": lambda checkpoint: STFormer(3, 8, 4, checkpoint),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_the_same_gradients_on_less_memory(name: str) -> None:
    stored, again = (NETWORKS[name](checkpoint) for checkpoint in (False, True))
    again.load_state_dict(stored.state_dict())
    measurement, mask = torch.rand(1, 21, 18), torch.rand(3, 21, 18)
    result, peaks = [], []
    for decoder in (stored, again):
        with Peak() as peak:
            result.append(gradients(decoder, measurement, mask))
        # without the gradients of the parameters, which stay
        peaks.append(peak.bytes - sum(4 * parameter.numel() for parameter in decoder.parameters()))
    for reference, gradient in zip(*result, strict=True):
        torch.testing.assert_close(gradient, reference, rtol=0, atol=1e-6 * float(reference.abs().max()))
    assert peaks[1] < 0.7 * peaks[0]


@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
def test_large_clips_take_half_the_memory_by_themselves(precision: str) -> None:
    """Attention is computed again in the backward pass; the gradients, that of the mask included, are the same."""
    decoder = Res2former(16, (4, 4))
    measurement, mask = torch.rand(1, 32, 32), torch.rand(4, 32, 32)
    result, kept = [], []
    for times in (1.0, 1e9):
        with computed_as_larger(times), mixed_precision(precision, torch.device("cpu")), LiveBytes() as live:
            mask.grad, mask.requires_grad = None, True
            decoder.zero_grad()
            loss = decoder(measurement, mask).square().mean()
            kept.append(live.now)
        loss.backward()
        result.append([value.grad.clone() for value in (mask, *decoder.parameters()) if value.grad is not None])
    assert all(torch.equal(*pair) for pair in zip(*result, strict=True))
    assert kept[1] < 0.55 * kept[0]
