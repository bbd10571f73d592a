"""Whether a snapshot is decoded at once or in tiles, and in which: what ``tile=`` says, and what memory allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.tiling.memory import DecodingMemory, decoding_memory, free_memory
from sci_lightning.decoder.tiling.tiling import Size, Tiling
from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import readable_bytes

SMALL = 256 * 256
"""Pixels of a field that is decoded at once without asking how much memory that takes: the papers' size."""

SHARE = 0.8
"""Part of the free memory that decoding may take."""

TILE_MEMORY = 7 * 2**28
"""Most bytes that one tile may take on a processor, where larger ones are no faster."""


class TileChoice:
    """Chooses the tiles of a decoder for a field, once for every size.

    Args:
        tile: ``auto`` decodes at once what is small, and cuts the rest so that a tile needs a moderate amount of
            memory; ``none`` always decodes at once; (height, width) of a tile in pixels, without its halo.
        say: called with one line that says what ``auto`` has chosen; None: nothing is said.
        watch: called after every tile with its number, from 1, and the number of tiles.

    Raises:
        BadInput: something else is given for ``tile``.
    """

    def __init__(
        self,
        tile: str | Sequence[int] | None = "auto",
        say: Callable[[str], object] | None = None,
        watch: Callable[[int, int], object] | None = None,
    ) -> None:
        self.tile: object = "none" if tile is None else tile
        if isinstance(tile, Sequence) and not isinstance(tile, str):
            self.tile = tuple(tile)
        whole = isinstance(self.tile, tuple) and len(self.tile) == 2 and all(type(side) is int for side in self.tile)
        if self.tile not in ("auto", "none") and not whole:
            given = f"[{','.join(map(str, self.tile))}]" if isinstance(self.tile, tuple) else tile
            raise BadInput(
                f"tile={given}: give auto, none, or height and width of a tile in pixels, as in 'tile=[256,256]'"
            )
        self.say, self.watch = say, watch
        self._made: dict[tuple[object, ...], Tiling | None] = {}
        self._memory: dict[tuple[object, ...], DecodingMemory] = {}

    def tiling(self, decoder: Decoder, measurement: torch.Tensor, mask: torch.Tensor) -> Tiling | None:
        """Return how to cut the field of a measurement ``(N, H, W)`` with a mask ``(T, H, W)``; None: not at all.

        Raises:
            BadInput: what was asked for, or even the smallest tiles, need more memory than there is.
        """
        device = measurement.device
        key = id(decoder), measurement.shape, len(mask), device, torch.is_autocast_enabled(device.type)
        if key not in self._made:
            if isinstance(self.tile, tuple):
                self._made[key] = self._as_asked((self.tile[0], self.tile[1]), decoder, measurement, mask)
            else:
                self._made[key] = self._by_memory(decoder, measurement, mask)
        return self._made[key]

    def _as_asked(self, size: Size, decoder: Decoder, measurement: torch.Tensor, mask: torch.Tensor) -> Tiling:
        """Return tiles of a size that was given, if they fit into the memory."""
        field, device = (mask.shape[-2], mask.shape[-1]), measurement.device
        tiling = Tiling(size, watch=self.watch)
        largest = max(tile.pixels for tile in tiling.tiles(field, decoder.halo, decoder.alignment))
        if largest > SMALL:
            most = int(SHARE * free_memory(device))
            need = len(measurement) * self._memory_of(decoder, len(mask), device).in_tiles(field, largest)
            need += decoder.kept_bytes(*field)
            if need > most:
                needs = self._needs(decoder, field, need, most)
                raise BadInput(f"tile=[{size[0]},{size[1]}]: {needs}; give smaller tiles, or tile=auto")
        return tiling

    def _memory_of(self, decoder: Decoder, frames: int, device: torch.device) -> DecodingMemory:
        """Return how much memory a decoder needs, which is measured once."""
        known = id(decoder), frames, torch.is_autocast_enabled(device.type)
        if known not in self._memory:
            self._memory[known] = decoding_memory(decoder, *known[1:])
        return self._memory[known]

    def _by_memory(self, decoder: Decoder, measurement: torch.Tensor, mask: torch.Tensor) -> Tiling | None:
        field, snapshots, device = (mask.shape[-2], mask.shape[-1]), len(measurement), measurement.device
        if field[0] * field[1] <= SMALL:
            return None
        memory = self._memory_of(decoder, len(mask), device)
        most = int(SHARE * free_memory(device))
        matrices = decoder.kept_bytes(*field)
        whole = snapshots * memory.whole(field) + matrices
        if self.tile == "none":
            if whole > most:
                raise BadInput(f"tile=none: {self._needs(decoder, field, whole, most)}; give tile=auto")
            return None
        kept = snapshots * memory.in_tiles(field, 0) + matrices
        allowed = most - kept if device.type != "cpu" else min(most - kept, TILE_MEMORY)
        if whole <= kept + allowed:
            return None
        tiling = Tiling(pixels=max(1, int(allowed / max(1.0, snapshots * memory.tile))), watch=self.watch)
        tiles = tiling.tiles(field, decoder.halo, decoder.alignment)
        largest = max(tiles, key=lambda tile: tile.pixels)
        need = snapshots * memory.in_tiles(field, largest.pixels) + matrices
        if need > most:
            raise BadInput(
                f"{self._needs(decoder, field, need, most)}; give fewer snapshots at once, or use a machine with more"
            )
        if self.say is not None and len(tiles) > 1:
            self.say(
                f"tile=auto: {len(tiles)} tiles of up to {len(largest.rows)} x {len(largest.columns)} pixels with "
                f"halos of {decoder.halo}, about {readable_bytes(need)} (at once: {readable_bytes(whole)})"
            )
        return tiling

    @staticmethod
    def _needs(decoder: Decoder, field: Size, need: int, most: int) -> str:
        return (
            f"{type(decoder).__name__} needs about {readable_bytes(need)} for {field[0]} x {field[1]} pixels, and may "
            f"take {readable_bytes(most)} of this machine's memory"
        )
