"""Which captures and pixels are fitted, and which are held out to judge the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.errors import BadInput


@dataclass(frozen=True)
class Split:
    """Attributes:
    fitted: ``(N, H, W)`` bool: pixels that fits may see.
    captures: the captures, as numbered in the file, that are held out as a whole.
    held_capture: ``(N,)`` bool, the same in the observation's order.
    block: pixels along the side of a held-out block.
    one_in: one capture of so many of each kind is held out, and one block of so many squared of every other.
    """

    fitted: torch.Tensor
    captures: tuple[int, ...]
    held_capture: torch.Tensor
    block: int = SearchSettings.held_out_block
    one_in: int = SearchSettings.held_out_one_in

    @property
    def held(self) -> torch.Tensor:
        """``(N, H, W)`` bool: pixels that only judge."""
        return ~self.fitted

    def describe(self) -> dict[str, Any]:
        """For the report."""
        one = (
            {} if self.captures else {"note": "one capture of its kind each: none is held out as a whole, only blocks"}
        )
        if len(self.held_capture) == 1:
            one = {"note": "one capture only: none is held out as a whole, only blocks of it"}
        return one | {
            "held_out_captures": list(self.captures),
            "fitted_captures": int((~self.held_capture).sum()),
            "held_out_blocks": f"{self.block} x {self.block} pixels, one in {self.one_in**2} of every fitted capture",
            "held_out_fraction": round(float(self.held.float().mean()), 4),
            "held_out": bool(self.held.any()),
        }


def split(observation: Observation, settings: SearchSettings | None = None) -> Split:
    """Divide the pixels; by content, so that neither the order nor the labels of the captures matter.

    Of a single capture nothing is held out as a whole, only blocks of it.
    """
    settings = settings or SearchSettings()
    kinds, block, one_in = observation.kinds, settings.held_out_block, settings.held_out_one_in
    held = torch.zeros(len(kinds), dtype=torch.bool)
    for kind in sorted(set(kinds)):
        members = [n for n, each in enumerate(kinds) if each == kind]
        held[members[one_in - 1 :: one_in] or (members[1:2] if len(members) > 1 else [])] = True
    height, width = observation.size
    side = min(block, max(1, min(height, width) // 4))
    row = torch.arange(height)[:, None] // side
    column = torch.arange(width)[None] // side
    turn = torch.arange(len(kinds))[:, None, None]
    blocks = (row * 5 + column * 3 + turn * 7) % one_in**2 == 0
    fitted = ~(blocks | held[:, None, None])
    if not fitted.any():
        raise BadInput(f"captures of {height} x {width} pixels: none is left to fit; expected at least 4 x 4 pixels")
    return Split(fitted, tuple(sorted(observation.number[held].tolist())), held, block, one_in)
