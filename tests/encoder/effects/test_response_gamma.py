"""Out = in ** gamma, noise carried through; undone before decoding."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import ResponseGamma
from sci_lightning.encoder.signal import Signal
from tests.encoder.effects.conftest import encoder, seen

GREY = torch.full((2, 2, 2), 0.25)  # 0.5 in all


def test_formula() -> None:
    assert float(seen(ResponseGamma(gamma=2.0), GREY)[0, 0]) == pytest.approx(0.25)
    camera = encoder(ResponseGamma(gamma=2.0), pattern=GREY)
    assert float(camera.linearise(torch.full((1, 2, 2), 0.25))[0, 0, 0]) == pytest.approx(0.5)
    signal = Signal(torch.full((1, 1, 1), 0.5), torch.tensor(1e-4), torch.ones(1, 1, 1), 1 / 255, (0, 0), (1, 1))
    assert float(ResponseGamma(gamma=2.0).respond(signal).variance) == pytest.approx(1e-4, rel=1e-3)  # slope 1 at 0.5
