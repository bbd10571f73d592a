"""Some pixels have an excess that does not depend on the light."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects import HotPixels
from sci_lightning.encoder.signal import Signal
from tests.encoder.effects.conftest import encoder, seen


def test_formula() -> None:
    effect = HotPixels(size=(40, 40), fraction=0.05, seed=1)
    hot = effect.map > 0
    assert 0.02 < float(hot.float().mean()) < 0.09 and float(effect.map[hot].min()) >= 0.05
    assert float(effect.map.max()) <= 0.6
    for light in (0.0, 0.25):
        result = seen(effect, torch.full((2, 40, 40), light))
        torch.testing.assert_close(result, 2 * light + effect.map)
        camera = encoder(effect, pattern=torch.full((2, 40, 40), light))
        torch.testing.assert_close(camera.linearise(result[None]), torch.full((1, 40, 40), 2 * light))


def test_it_grows_with_the_integration_time() -> None:
    effect = HotPixels(size=(1, 1), fraction=1.0)
    signal = Signal(torch.zeros(2, 1, 1), torch.zeros(()), torch.tensor([1.0, 3.0])[:, None, None], 1, (0, 0), (1, 1))
    once, thrice = effect.respond(signal).mean.flatten()
    assert once > 0 and thrice == 3 * once
