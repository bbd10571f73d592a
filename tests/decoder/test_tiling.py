"""How a field is cut, and what ``tile=`` chooses by the memory that there is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch

from sci_lightning.decoder import E2ECNN, Decoder, GAPNet, Linear
from sci_lightning.decoder.tiling import memory as memory_module
from sci_lightning.decoder.tiling import tile_choice
from sci_lightning.decoder.tiling.memory import LiveBytes, decoding_memory, free_memory
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.decoder.tiling.tiling import Tiling
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import RandomBinary
from sci_lightning.encoder.sensor import Ideal
from sci_lightning.errors import BadInput
from sci_lightning.pipeline import Pipeline

LARGE = (300, 420)
"""A field of more pixels than are decoded at once without asking."""


@pytest.mark.parametrize("field", [(17, 400), (256, 256), (1644, 3840)])
@pytest.mark.parametrize("tiling", [Tiling((60, 48)), Tiling(pixels=40_000)])
@pytest.mark.parametrize(("halo", "alignment"), [(0, 1), (16, 14), (23, 4)])
def test_tiles_cover_the_field_once(field: tuple[int, int], tiling: Tiling, halo: int, alignment: int) -> None:
    counted = torch.zeros(field, dtype=torch.int)
    for tile in tiling.tiles(field, halo, alignment):
        counted[tile.rows.kept, tile.columns.kept] += 1
        for span, side in ((tile.rows, field[0]), (tile.columns, field[1])):
            assert span.start % alignment == span.read_start % alignment == 0
            assert span.read_start in (0, span.start - -(-halo // alignment) * alignment)
            assert span.read_stop == side or span.read_stop - span.stop >= halo
        if tiling.pixels:
            assert tile.pixels <= tiling.pixels
    assert bool((counted == 1).all())


def test_as_few_tiles_as_memory_allows() -> None:
    tiles = Tiling(pixels=226_000).tiles((768, 1024), 16, 4)
    assert len(tiles) == 4
    assert sum(tile.pixels for tile in tiles) < 1.08 * 768 * 1024


@pytest.fixture
def decoder() -> E2ECNN:
    return E2ECNN(frames=4, channels=8, blocks=1).eval()


def place(field: tuple[int, int], frames: int = 4) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.rand(1, *field), (torch.rand(frames, *field) < 0.5).float()


@torch.no_grad()
def test_a_notebook_decodes_in_tiles_with_one_argument(decoder: E2ECNN, monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline = Pipeline(Encoder(RandomBinary(4, LARGE), Ideal()), decoder)
    linear, mask = place(LARGE)
    whole = pipeline.decode(linear, mask)
    assert torch.allclose(pipeline.decode(linear, mask, tile=[64, 80]), whole, atol=1e-6)
    monkeypatch.setattr(tile_choice, "TILE_MEMORY", 10_000_000)
    assert torch.allclose(pipeline.decode(linear, mask, tile="auto"), whole, atol=1e-6)


def test_what_auto_chooses(decoder: E2ECNN, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    assert TileChoice("auto", say=lines.append).tiling(decoder, *place((256, 256))) is None
    assert TileChoice("auto", say=lines.append).tiling(decoder, *place(LARGE)) is None and not lines
    monkeypatch.setattr(tile_choice, "TILE_MEMORY", 10_000_000)
    choice = TileChoice("auto", say=lines.append)
    tiling = choice.tiling(decoder, *place(LARGE))
    assert tiling is choice.tiling(decoder, *place(LARGE))
    assert tiling is not None and len(lines) == 1
    number = len(tiling.tiles(LARGE, decoder.halo, decoder.alignment))
    assert number > 1 and lines[0].startswith(f"tile=auto: {number} tiles of up to ") and "at once: " in lines[0]


@pytest.mark.parametrize("tile", ["none", "auto", [300, 420]])
def test_what_memory_cannot_hold_is_refused_before_it_starts(
    tile: str | list[int], decoder: E2ECNN, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tile_choice, "free_memory", lambda device: 2_000_000)
    with pytest.raises(BadInput, match=r"E2ECNN .*iB for 300 x 420 .* 1\.5 MiB"):
        TileChoice(tile).tiling(decoder, *place(LARGE))


@pytest.mark.parametrize("tile", ["some", [64], [64, 0], [64, 1.5], True])
def test_settings_that_are_none(tile: object, decoder: E2ECNN) -> None:
    given = str(tile).replace(" ", "")
    with pytest.raises(BadInput, match=rf"tile={re.escape(given)}: "):
        TileChoice(tile).tiling(decoder, *place(LARGE))  # type: ignore[arg-type]


@torch.no_grad()
@pytest.mark.parametrize(
    "network", [E2ECNN(frames=4, channels=16, blocks=1), GAPNet(frames=4, stages=3, channels=(8, 8, 8))]
)
def test_the_estimate_of_memory(network: Decoder) -> None:
    """Of what torch's operations really make, in tiles and at once, the estimate is right to a fifth."""
    field = (192, 640)
    measurement, mask = place(field)
    memory, tiling = decoding_memory(network, 4), Tiling((192, 160))
    given = measurement.nbytes + mask.nbytes
    pixels = max(tile.pixels for tile in tiling.tiles(field, network.halo, network.alignment))
    for estimated, call in (
        (memory.whole(field), lambda: network(measurement, mask)),
        (memory.in_tiles(field, pixels), lambda: network.in_tiles(measurement, mask, tiling)),
    ):
        with LiveBytes() as live:
            call()
        assert live.peak + given == pytest.approx(estimated, rel=0.2)


@pytest.mark.parametrize("decoder", [Linear(), E2ECNN(frames=8, channels=16, blocks=1, first_estimate="linear")])
def test_matrices_of_a_mask_do_not_grow_with_the_field(decoder: Decoder, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a linear estimate keeps for a mask is bounded, so that a large field fits into an ordinary machine."""
    monkeypatch.setattr(tile_choice, "free_memory", lambda device: 8 * 2**30)
    place = torch.empty(1).expand(1, 1024, 1024), torch.empty(1).expand(8, 1024, 1024)
    TileChoice("auto").tiling(decoder, *place)
    assert 2**30 < decoder.kept_bytes(1024, 1024) < 3 * 2**30
    monkeypatch.setattr(tile_choice, "free_memory", lambda device: 2**30)
    with pytest.raises(BadInput, match=r"needs about .* may take"):
        TileChoice("auto").tiling(decoder, *place)


def test_free_memory_of_a_container(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that were read, and can be read again, take nothing away."""
    for name, text in (("max", "1000"), ("current", "900"), ("stat", "anon 300\nfile 600\ninactive_file 500\n")):
        (tmp_path / f"memory.{name}").write_text(text)
    place = (str(tmp_path), "memory.max", "memory.current", "inactive_file")
    monkeypatch.setattr(memory_module, "CGROUP", (place,))
    assert free_memory(torch.device("cpu")) == 600
    (tmp_path / "memory.max").write_text("max\n")
    assert free_memory(torch.device("cpu")) > 2**24


def test_free_memory_is_what_the_system_says() -> None:
    assert 2**24 < free_memory(torch.device("cpu")) < 2**50
