"""Activations computed again: the same gradients, on less memory."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from sci_lightning.decoder import Decoder, Res2former, STFormer
from tests.decoder.test_revsci import Peak, gradients

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
