"""What ``tile=`` says is checked against the memory before anything is decoded."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.decoder import E2ECNN
from sci_lightning.errors import BadInput
from sci_lightning.imaging import tile_choice
from sci_lightning.imaging.tile_choice import TileChoice


def test_tiles_that_need_more_memory_than_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    decoder = E2ECNN(frames=2, channels=4, blocks=1).eval()
    measurement, mask = torch.zeros(1, 400, 400), torch.zeros(2, 400, 400)
    assert TileChoice([300, 300]).tiling(decoder, measurement, mask) is not None
    monkeypatch.setattr(tile_choice, "free_memory", lambda device: 2**20)
    with pytest.raises(BadInput, match=r"tile=\[300,400\]: E2ECNN needs about .* for 400 x 400 pixels.*smaller tiles"):
        TileChoice([300, 400]).tiling(decoder, measurement, mask)
    with pytest.raises(BadInput, match=r"tile=none: E2ECNN needs about"):
        TileChoice("none").tiling(decoder, measurement, mask)
    assert TileChoice([64, 64]).tiling(decoder, measurement, mask) is not None  # too small to ask


@pytest.mark.parametrize(("tile", "given"), [([7], "[7]"), (["a", "b"], "[a,b]"), (3.5, "3.5")])
def test_what_is_no_tile(tile: object, given: str) -> None:
    with pytest.raises(BadInput) as error:
        TileChoice(tile)  # type: ignore[arg-type]
    assert str(error.value).startswith(f"tile={given}: give auto, none, or height and width")
