"""A part of the light spreads evenly, none is lost."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects import VeilingGlare
from tests.encoder.effects.conftest import encoder, seen


def test_formula() -> None:
    pattern = torch.tensor([[0.0, 0.0], [0.0, 1.0]])[None] * torch.tensor([1.0, 0.0])[:, None, None]
    result = seen(VeilingGlare(fraction=0.2), pattern)
    torch.testing.assert_close(result, torch.tensor([[0.05, 0.05], [0.05, 0.85]]))
    camera = encoder(VeilingGlare(fraction=0.2), pattern=pattern)
    torch.testing.assert_close(camera.linearise(result[None])[0], pattern[0])
