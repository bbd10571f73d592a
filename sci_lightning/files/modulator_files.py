"""A mask as a modulator displays it: bit planes and gray frames as PNG, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from PIL import Image
from pydantic import model_validator

from sci_lightning.configuration.bounds import Bits, Frames, Pixels
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.folder import is_inside
from sci_lightning.files.json_file import JsonFile, JsonObject, Number, read_json, says, write_json
from sci_lightning.files.memory_bound import check_memory

SHEET = "planes.json"
LARGEST_BITS = 8
"""Bits of the finest levels that a modulator displays."""


def display_times(bits: int, order: str) -> list[tuple[int, float, float]]:
    """Return every plane of a level, in the order of display, with the parts of the slot at which it begins and ends.

    The planes fill the slot: plane k is displayed for 2^k of 2^b - 1 shares of it.

    Args:
        bits: b, 1 to 8.
        order: ``msb_first`` or ``lsb_first``, the most or the least significant bit first.
    """
    times, begin = [], 0
    for bit in range(bits) if order == "lsb_first" else reversed(range(bits)):
        times.append((bit, begin / (2**bits - 1), (begin + 2**bit) / (2**bits - 1)))
        begin += 2**bit
    return times


class Timing(JsonObject):
    """Whether the modulator is fast enough for the wanted snapshots per second."""

    frame_rate_Hz: Number = says("wanted snapshots per second")
    slot_s: float = says("duration of a slot")
    shortest_plane_s: float = says("of the least significant plane where the planes fill the slot")
    phased_reset_slots: float = says("between the first and the last mirrors' change", ge=0, default=0.0)
    fastest_by_planes_Hz: float = says("most snapshots per second with bit planes")
    fastest_by_gray_frames_Hz: float = says("most snapshots per second with 8-bit frames")
    planes_fit: bool
    gray_frames_fit: bool


class Plane(JsonObject):
    """One bit plane, in the order of display."""

    file: str = says("1-bit PNG, relative to planes.json")
    slot: int = says("that the plane belongs to, from 0", ge=0)
    bit: int = says("of the mask value, 0 for the least significant", ge=0, le=7)
    exposure: float = says("part of the slot for which it is shown", ge=0, le=1)
    begin: float = says("of its display, where the planes fill the slot: part of the slot", ge=0, le=1, default=0.0)
    end: float = says("of its display, likewise", ge=0, le=1, default=1.0)


class Planes(JsonFile):
    """``planes.json`` beside the folders ``planes/`` and ``frames/`` of an exported mask."""

    format: Literal["sci-planes"] = "sci-planes"
    format_version: Literal[1] = 1
    frames: Frames = says("T, slots of an exposure")
    bits: Bits = says("of a mask value")
    order: Literal["msb_first", "lsb_first"] = says("of the planes of a slot", default="msb_first")
    full_level: int = says("level that means a transmittance of 1", ge=1, le=256)
    size: tuple[Pixels, Pixels] = says("(H, W) of the mask")
    repeat: Pixels = says("mirrors that each value covers, down and across")
    canvas: tuple[Pixels, Pixels] = says("(H, W) of the modulator in mirrors")
    timing: Timing
    planes: list[Plane] = says("in the order of display", min_length=1)

    @model_validator(mode="after")
    def _fits(self) -> Planes:
        if len(self.planes) > self.frames * self.bits or any(
            plane.slot >= self.frames or plane.bit >= self.bits for plane in self.planes
        ):
            raise ValueError("planes: expected one for every bit of every slot")
        return self


@dataclass(frozen=True)
class Layout:
    """Where a mask lies on the modulator.

    Attributes:
        size: (H, W) of the mask.
        repeat: mirrors that each value covers, down and across.
        canvas: (H, W) of the modulator in mirrors.

    Raises:
        BadInput: the mask is larger than the modulator.
    """

    size: tuple[int, int]
    repeat: int
    canvas: tuple[int, int]

    def __post_init__(self) -> None:
        if self.repeat < 1:
            raise BadInput(f"repeat={self.repeat}: each value must cover at least 1 mirror")
        if any(part > full for part, full in zip(self.covered, self.canvas, strict=True)):
            raise BadInput(
                f"canvas={list(self.canvas)}: the mask covers {list(self.covered)} mirrors (H, W); "
                "give a larger canvas or a smaller repeat"
            )

    @property
    def covered(self) -> tuple[int, int]:
        """(H, W) in mirrors."""
        return self.repeat * self.size[0], self.repeat * self.size[1]

    @property
    def corner(self) -> tuple[int, int]:
        """(row, column) of the first mirror that the mask covers."""
        (h, w), (height, width) = self.covered, self.canvas
        return (height - h) // 2, (width - w) // 2

    def lay_out(self, values: torch.Tensor) -> torch.Tensor:
        """``(H, W)`` values as ``canvas`` mirrors; those around are 0."""
        shown = values.new_zeros(self.canvas)
        (top, left), (h, w) = self.corner, self.covered
        shown[top : top + h, left : left + w] = values.repeat_interleave(self.repeat, 0).repeat_interleave(
            self.repeat, 1
        )
        return shown

    def cut_out(self, shown: torch.Tensor) -> torch.Tensor:
        """The reverse of :meth:`lay_out`."""
        (top, left), (h, w) = self.corner, self.covered
        return shown[top : top + h : self.repeat, left : left + w : self.repeat]


def levels_of(mask: torch.Tensor, bits: int) -> tuple[torch.Tensor, int]:
    """Whole levels of a mask, and the level that is transmittance 1.

    Args:
        mask: ``(T, H, W)`` whose values are multiples of 1/2^bits below 1, or 0 and 1 for 1 bit.
        bits: 1 to 8.

    Raises:
        BadInput: other values.
    """
    full = 2**bits if bits > 1 else 1
    levels = (mask * full).round().to(torch.uint8)
    if not torch.equal(levels.float() / full, mask.float()) or int(levels.max()) >= 2**bits:
        raise BadInput(f"the mask's values are no levels of {bits} bits; masks that are binary or structural have such")
    return levels, full


def write_planes(
    mask: torch.Tensor,
    bits: int,
    folder: str | Path,
    layout: Layout,
    timing: Timing,
    order: Literal["msb_first", "lsb_first"] = "msb_first",
) -> None:
    """Write 1-bit planes in the order of display, 8-bit frames, and ``planes.json``, which says what they are.

    A slot of b bits is b planes, see :func:`display_times`. The 8-bit frames hold 255 at the transmittance 1.
    """
    folder = Path(folder)
    levels, full = levels_of(mask, bits)
    (folder / SHEET).unlink(missing_ok=True)  # written last: it says that all pictures are of one mask
    for stale in (*folder.glob("planes/slot*_bit*.png"), *folder.glob("frames/slot*.png")):
        stale.unlink()  # of an earlier export with more slots or bits, which a modulator would show as well
    planes = []
    for slot, level in enumerate(levels):
        for bit, begin, end in display_times(bits, order):
            name = f"planes/slot{slot + 1:02d}_bit{bit}.png"
            shown = layout.lay_out((level >> bit) & 1)
            _write_png(folder / name, Image.fromarray(shown.bool().numpy()))
            planes.append(Plane(file=name, slot=slot, bit=bit, exposure=2**bit / full, begin=begin, end=end))
        gray = layout.lay_out((level.float() / full * 255).round().to(torch.uint8))
        _write_png(folder / f"frames/slot{slot + 1:02d}.png", Image.fromarray(gray.numpy()))
    sheet = Planes(
        frames=len(levels),
        bits=bits,
        order=order,
        full_level=full,
        size=layout.size,
        repeat=layout.repeat,
        canvas=layout.canvas,
        timing=timing,
        planes=planes,
    )
    write_json(sheet.as_json(), folder / SHEET)


def read_planes(folder: str | Path) -> torch.Tensor:
    """The mask ``(T, H, W)`` float32 that :func:`write_planes` wrote, bit for bit.

    Raises:
        BadInput: a file is missing, damaged, or not of that shape.
    """
    folder = Path(folder)
    try:
        sheet = read_json(folder / SHEET, Planes)
        layout = Layout(sheet.size, sheet.repeat, sheet.canvas)
        check_memory(f"{sheet.frames} slots of {layout.canvas}", 16 * sheet.frames * math.prod(layout.canvas))
        levels = torch.zeros(sheet.frames, *layout.size, dtype=torch.int64)
        for plane in sheet.planes:
            path = folder / plane.file
            if not is_inside(path, folder):
                raise ValueError(f"{plane.file} is no file in this folder")
            levels[plane.slot] += layout.cut_out(_read_png(path, layout.canvas)) << plane.bit
        return levels.float() / sheet.full_level
    except (OSError, ValueError, TypeError, SyntaxError, Image.DecompressionBombError) as error:
        raise BadInput(
            f"{folder}: not the planes of a mask ({error}); give the folder that export_mask wrote"
        ) from error


def timing_of(
    frames: int, bits: int, frame_rate: float, binary_rate: float, gray_rate: float, reset_time: float = 0.0
) -> Timing:
    """Whether the modulator is fast enough for the wanted snapshots per second.

    Bit planes are weighted by how long they are shown, so a slot of b bits lasts at least 2^b - 1 of the shortest, and
    the shortest must not be shorter than 1 / ``binary_rate``. Planes that fill their slot so, without a dark rest, are
    shown 2^b / (2^b - 1) times as long as their ``exposure`` says: all of them alike, as by a wider aperture. Gray
    frames take 1 / ``gray_rate`` each.

    Args:
        frames: T; bits: of the mask.
        frame_rate: snapshots per second that are wanted.
        binary_rate, gray_rate: patterns per second that the modulator shows, 1-bit and 8-bit.
        reset_time: seconds between the changes of the first and the last block of mirrors; 0: all change together.

    Raises:
        BadInput: a rate that is not positive, or a reset that takes longer than a slot.
    """
    if min(frame_rate, binary_rate, gray_rate) <= 0:
        raise BadInput("frame_rate, binary_rate and gray_rate must be positive (per second)")
    if not 0 <= reset_time <= 1 / (frame_rate * frames):
        raise BadInput(
            f"reset_time={reset_time:g} s: a slot lasts {1 / (frame_rate * frames):g} s; reset within a slot"
        )
    shortest = 1 / (frame_rate * frames * (2**bits - 1))
    fastest = {"planes": binary_rate / (frames * (2**bits - 1)), "gray": gray_rate / frames}
    return Timing(
        frame_rate_Hz=frame_rate,
        slot_s=1 / (frame_rate * frames),
        shortest_plane_s=shortest,
        phased_reset_slots=reset_time * frame_rate * frames,
        fastest_by_planes_Hz=fastest["planes"],
        fastest_by_gray_frames_Hz=fastest["gray"],
        planes_fit=frame_rate <= fastest["planes"],
        gray_frames_fit=frame_rate <= fastest["gray"],
    )


def _write_png(path: Path, picture: Image.Image) -> None:
    with atomic_write(path) as temporary:
        picture.save(temporary)


def _read_png(path: Path, canvas: tuple[int, int]) -> torch.Tensor:
    with Image.open(path, formats=["PNG"]) as picture:
        if picture.mode != "1" or picture.size != canvas[::-1]:
            raise ValueError(f"{path.name} is {picture.mode} {picture.size}, expected 1-bit {canvas[::-1]}")
        return torch.from_numpy(np.array(picture)).long()
