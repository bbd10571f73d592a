"""Every pixel's light times 1 + std * map; the map is smooth."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import Illumination
from tests.encoder.effects.conftest import encoder, seen


def test_formula() -> None:
    effect = Illumination(size=(6, 8), std=0.1)
    assert float(effect.map.mean()) == pytest.approx(0, abs=1e-6) and float(effect.map.std()) == pytest.approx(1)
    result = seen(effect, torch.full((2, 6, 8), 0.25))
    torch.testing.assert_close(result, 0.5 * (1 + 0.1 * effect.map))
    camera = encoder(effect, pattern=torch.full((2, 6, 8), 0.25))
    torch.testing.assert_close(camera.linearise(result[None]), torch.full((1, 6, 8), 0.5))


def test_a_drawn_map_is_smooth_and_follows_the_seed() -> None:
    one, same, other = (Illumination(size=(64, 48), std=0.1, seed=seed).map for seed in (1, 1, 2))
    assert torch.equal(one, same) and not torch.equal(one, other)
    assert (one[1:] - one[:-1]).abs().max() < 0.3 and (one[:, 1:] - one[:, :-1]).abs().max() < 0.3
