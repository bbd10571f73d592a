"""Every pixel's light times 1 + std * map, before the photons are counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.encoder.effects import Prnu
from sci_lightning.errors import BadInput
from tests.encoder.effects.conftest import encoder, seen


def test_formula() -> None:
    effect = Prnu(size=(2, 2), std=0.1)
    assert float(effect.map.mean()) == pytest.approx(0, abs=1e-6) and float(effect.map.std()) == pytest.approx(1)
    result = seen(effect, torch.full((2, 2, 2), 0.25))
    torch.testing.assert_close(result, 0.5 * (1 + 0.1 * effect.map))
    camera = encoder(effect, pattern=torch.full((2, 2, 2), 0.25))
    torch.testing.assert_close(camera.linearise(result[None]), torch.full((1, 2, 2), 0.5))


def test_map_from_a_file(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", np.array([[0.0, 1.0], [2.0, -1.0]]))
    effect = Prnu(size=(2, 2), file=tmp_path / "map.npy", std=0.1)
    assert effect.map.tolist() == [[0, 1], [2, -1]]
    assert "map" in effect.state_dict()
    with pytest.raises(BadInput, match=r"prnu is \(2, 2\).*\(3, 2\)"):
        Prnu(size=(3, 2), file=tmp_path / "map.npy")
