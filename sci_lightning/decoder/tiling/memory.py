"""How much memory a decoder needs, measured on tensors without values and so in no time, and how much is free."""

from __future__ import annotations

import os
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch.func import functional_call
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.tiling.tiling import Size, Tiling

PROBE = 256
"""Height and width in pixels of the field on which memory is measured."""

PROBE_FRAMES = 8
"""Number of frames with which memory is measured, if the decoder takes any."""

LOWER_PRECISION = 0.55
"""Memory of features in bfloat16, with the few that stay in float32, over that of float32; measured 0.50 to 0.53."""

MEMORY_INFORMATION = Path("/proc/meminfo")

CGROUP = (
    ("/sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
    ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)
"""Where the system says how much memory a container may use, how much it does, and, in ``memory.stat``, how much of
that holds files which it can read again."""


@dataclass(frozen=True)
class DecodingMemory:
    """The memory that one snapshot needs beside the weights.

    Args:
        field: bytes for every pixel of the field, which stay from the beginning to the end: mask, estimate, and what
            steps on the whole field keep.
        tile: bytes for every pixel of the tile that is being decoded, with its halo.
    """

    field: float
    tile: float

    def whole(self, field: Size) -> int:
        """Return the bytes needed to decode a field of so many rows and columns at once."""
        return int((self.field + self.tile) * field[0] * field[1])

    def in_tiles(self, field: Size, pixels: int) -> int:
        """Return the bytes needed to decode it in tiles, of which the largest has so many pixels with its halo."""
        return int(self.field * field[0] * field[1] + self.tile * pixels)


def decoding_memory(decoder: Decoder, frames: int, lower_precision: bool = False) -> DecodingMemory:
    """Return how much memory a decoder needs for one snapshot.

    Args:
        decoder: any decoder.
        frames: T.
        lower_precision: whether it computes in bfloat16 or float16.
    """
    light = decoder.abridged()
    frames, more = (frames, 1.0) if decoder.frames else (min(frames, PROBE_FRAMES), max(1.0, frames / PROBE_FRAMES))
    factor = LOWER_PRECISION if lower_precision else 1.0
    images = 4 * (2 * frames + 1)  # mask, estimate and measurement, for every pixel
    whole = _peak(light, frames, (PROBE, PROBE)) / PROBE**2
    if not light.global_steps:
        return DecodingMemory(more * images, more * factor * whole)
    # Peaks in bytes for every pixel of the field: whole = kept + tile, and in tiles = kept + tile * pixels / area.
    tiling, field = Tiling((PROBE, PROBE)), (PROBE, 3 * PROBE)
    area, pixels = field[0] * field[1], max(tile.pixels for tile in tiling.tiles(field, light.halo, light.alignment))
    tile = max(0.0, (whole - _peak(light, frames, field, tiling) / area) / (1 - pixels / area))
    return DecodingMemory(more * (images - 4 * frames + max(0.0, whole - tile)), more * tile)  # with its estimate


def _peak(decoder: Decoder, frames: int, field: Size, tiling: Tiling | None = None) -> int:
    """Return the largest number of bytes that exist at once while one snapshot is decoded."""
    module: torch.nn.Module = decoder if tiling is None else _InTiles(decoder, tiling)
    state = {name: value.to("meta") for name, value in (*module.named_parameters(), *module.named_buffers())}
    measurement = torch.empty(1, *field, device="meta")
    mask = torch.empty(frames, *field, device="meta")
    with torch.no_grad(), torch.autocast("cpu", enabled=False), LiveBytes() as live:
        functional_call(module, state, (measurement, mask))
    return live.peak


def kept_for_gradients(decoder: Decoder, frames: int, size: Size, lower_precision: bool = False) -> float:
    """Return the bytes that the forward pass of a training on one clip keeps for the backward pass.

    Args:
        decoder: on device ``meta``, in training mode.
        frames: T.
        size: (H, W) of the clip.
        lower_precision: whether it computes in bfloat16 or float16.
    """
    mask = torch.empty(frames, *size, device="meta")
    with torch.enable_grad(), torch.autocast("cpu", enabled=False), LiveBytes() as live:
        stages = decoder.stages(mask.sum(0, keepdim=True), mask)  # which keep what led to them
        kept = live.now
    del stages
    return kept * (LOWER_PRECISION if lower_precision else 1.0)


class _InTiles(torch.nn.Module):
    def __init__(self, decoder: Decoder, tiling: Tiling) -> None:
        super().__init__()
        self.decoder = decoder
        self.tiling = tiling

    def forward(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.decoder.in_tiles(measurement, mask, self.tiling)


class LiveBytes(TorchDispatchMode):
    """Counts the bytes of all tensors that torch's operations make, while they exist.

    Attributes:
        now: bytes that exist.
        peak: the most that have existed at once.
    """

    def __init__(self) -> None:
        super().__init__()
        self.now = self.peak = 0
        self._known: set[int] = set()

    @classmethod
    def _should_skip_dynamo(cls) -> bool:
        """Return False: torch's wrapper would load its compiler, for seconds, and nothing is compiled here."""
        return False

    def __torch_dispatch__(
        self, function: Any, types: Sequence[type], args: Sequence[Any] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        result = function(*args, **(kwargs or {}))
        for tensor in tree_leaves(result):
            if isinstance(tensor, torch.Tensor):
                storage = tensor.untyped_storage()
                if storage._cdata not in self._known:
                    self._known.add(storage._cdata)
                    self.now += storage.nbytes()
                    self.peak = max(self.peak, self.now)
                    weakref.finalize(storage, self._freed, storage._cdata, storage.nbytes())
        return result

    def _freed(self, storage: int, count: int) -> None:
        self._known.discard(storage)
        self.now -= count


def free_memory(device: torch.device) -> int:
    """Return how many bytes a computation on a device can still take.

    On a processor it is what the system calls available, or what the container's limit leaves, whichever is less.
    """
    if device.type == "cuda":
        free, _ = torch.cuda.mem_get_info(device)
        return free + torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    bounds: list[int] = []
    with suppress(OSError, ValueError, StopIteration):
        lines = MEMORY_INFORMATION.read_text().splitlines()
        bounds.append(1024 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1]))
    for folder, limit, used, cached in CGROUP:
        with suppress(OSError, ValueError):
            taken = int(Path(folder, used).read_text()) - _counted(Path(folder, "memory.stat"), cached)
            bounds.append(max(0, int(Path(folder, limit).read_text()) - taken))
    if not bounds:
        with suppress(OSError, ValueError, AttributeError):
            bounds.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2)
    return min(bounds, default=8 * 2**30)


def _counted(path: Path, name: str) -> int:
    """Return the number beside a name in a list of the system's; 0 without it."""
    with suppress(OSError, ValueError, StopIteration):
        return int(next(line for line in path.read_text().splitlines() if line.startswith(f"{name} ")).split()[1])
    return 0
