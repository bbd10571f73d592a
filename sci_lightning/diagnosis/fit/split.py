"""Which captures and pixels are fitted, and which are held out to validate the fit.

Held-out pixels take part in every choice of the search, so that it may have chosen what happens to suit them. Whole
captures are therefore set aside before for verification: neither fits nor choices see them, and they are opened once.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import torch

from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.encoder.border import Border
from sci_lightning.errors import BadInput

NO_BORDER = Border()
HELD_OUT_BLOCK = 16
"""Side in pixels of the square blocks that are held out, wide enough that blurs and maps fitted around a block say
little about its middle."""


@dataclass(frozen=True)
class Split:
    """Fitted and held-out pixels. Pixels of the border are neither.

    Attributes:
        assigned: ``(N, H, W)`` bool: True for pixels that fits may see, False for held-out ones, wherever they lie.
        held_out_captures: numbers, as in the file, of the captures that are held out as a whole.
        held_out_capture: ``(N,)`` bool, the same in the observation's order.
        block: side of a held-out block in pixels.
        one_in: one capture of so many of each kind is held out, and one block of so many squared of every other.
        border: pixels along the sides of the field that count nowhere, because what lies beyond it is unknown; whole
            numbers.
    """

    assigned: torch.Tensor
    held_out_captures: tuple[int, ...]
    held_out_capture: torch.Tensor
    block: int = HELD_OUT_BLOCK
    one_in: int = SearchSettings.held_out_one_in
    border: Border = NO_BORDER

    @staticmethod
    def all_alike(observation: Observation, fitted: bool, border: Border = NO_BORDER) -> Split:
        """Return the split by which every pixel inside a border is fitted, or every one is held out."""
        assigned = torch.full_like(observation.dn, fitted, dtype=torch.bool)
        return Split(assigned, (), torch.zeros(len(observation), dtype=torch.bool), border=border)

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the pixels that count."""
        height, width = self.assigned.shape[-2:]
        return self.border.window((height, width))

    @cached_property
    def fitted(self) -> torch.Tensor:
        """``(N, H, W)`` bool: pixels that fits may see."""
        return self.assigned & self._inside

    @cached_property
    def held_out(self) -> torch.Tensor:
        """``(N, H, W)`` bool: pixels that no fit sees."""
        return ~self.assigned & self._inside

    @property
    def pixels(self) -> int:
        """How many pixels count: fitted and held out."""
        return len(self.assigned) * int(self._inside.sum())

    @property
    def _inside(self) -> torch.Tensor:
        """``(H, W)`` bool: pixels that count."""
        inside = torch.zeros(self.assigned.shape[-2:], dtype=torch.bool)
        inside[self.window] = True
        return inside

    def describe(self) -> dict[str, Any]:
        """Return the split as it stands in ``report.json``."""
        note = {}
        if len(self.held_out_capture) == 1:
            note = {"note": "one capture only: none is held out as a whole, only blocks of it"}
        elif not self.held_out_captures:
            note = {"note": "one capture of its kind each: none is held out as a whole, only blocks"}
        return note | {
            "held_out_captures": list(self.held_out_captures),
            "fitted_captures": int((~self.held_out_capture).sum()),
            "held_out_blocks": f"{self.block} x {self.block} pixels, one in {self.one_in**2} of every fitted capture",
            "held_out_fraction": round(float(self.held_out.float().mean()), 4),
            "held_out": bool(self.held_out.any()),
            "border": {side: int(width) for side, width in asdict(self.border).items()},
            "counted_fraction": round(self.pixels / self.assigned.numel(), 4),
        }


def set_aside(observation: Observation, one_in: int) -> tuple[Observation, Observation | None]:
    """Divide captures into those for fits and choices, and those for verification.

    Args:
        observation: all captures with known scenes.
        one_in: one capture of so many of each kind is set aside where the file does not choose them; 0 for none. The
            choice follows from the captures' content, not from their order in the file.

    Returns:
        both parts; the second is None where nothing is set aside.

    Raises:
        BadInput: the file sets every capture aside.
    """
    aside = observation.verification
    if aside is None:
        aside = torch.zeros(len(observation), dtype=torch.bool)
        for kind in set(observation.kinds):
            members = [n for n, other in enumerate(observation.kinds) if other == kind]
            aside[members[one_in - 1 :: one_in] if one_in else []] = True
    if not aside.any():
        return observation, None
    if aside.all():
        raise BadInput("verification: every capture with a known scene is set aside; none is left to be fitted")
    return observation.take(~aside), observation.take(aside)


def split(observation: Observation, settings: SearchSettings | None = None) -> Split:
    """Divide the pixels into fitted and held-out ones.

    The division follows from the captures' content, so that neither their order nor their labels matter. Of a single
    capture of a kind nothing is held out as a whole, only blocks.

    Raises:
        BadInput: no pixel is left to be fitted.
    """
    settings = settings or SearchSettings()
    kinds, block, one_in = observation.kinds, HELD_OUT_BLOCK, settings.held_out_one_in
    held_out = torch.zeros(len(kinds), dtype=torch.bool)
    for kind in sorted(set(kinds)):
        members = [n for n, other in enumerate(kinds) if other == kind]
        held_out[members[one_in - 1 :: one_in] or (members[1:2] if len(members) > 1 else [])] = True
    height, width = observation.size
    side = min(block, max(1, min(height, width) // 4))
    row = torch.arange(height)[:, None] // side
    column = torch.arange(width)[None] // side
    capture = torch.arange(len(kinds))[:, None, None]
    blocks = (row * 5 + column * 3 + capture * 7) % one_in**2 == 0
    assigned = ~(blocks | held_out[:, None, None])
    if not assigned.any():
        raise BadInput(f"captures of {height} x {width} pixels: none is left to fit; expected at least 4 x 4 pixels")
    return Split(assigned, tuple(sorted(observation.number[held_out].tolist())), held_out, block, one_in)
