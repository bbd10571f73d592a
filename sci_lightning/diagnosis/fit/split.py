"""Which captures and pixels are fitted, and which are held out to judge the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.errors import BadInput

BLOCK = 16
"""Pixels along the side of a block."""
ONE_IN = 4
"""One capture in so many of each kind is held out as a whole, and one block in so many squared of every other."""


@dataclass(frozen=True)
class Split:
    """Attributes:
    fitted: ``(N, H, W)`` bool: pixels that fits may see.
    captures: the captures, as numbered in the file, that are held out as a whole.
    held_capture: ``(N,)`` bool, the same in the observation's order.
    """

    fitted: torch.Tensor
    captures: tuple[int, ...]
    held_capture: torch.Tensor

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
            "held_out_blocks": f"{BLOCK} x {BLOCK} pixels, one in {ONE_IN**2} of every fitted capture",
            "held_out_fraction": round(float(self.held.float().mean()), 4),
            "held_out": bool(self.held.any()),
        }


def split(observation: Observation) -> Split:
    """Divide the pixels; by content, so that neither the order nor the labels of the captures matter.

    Of a single capture nothing is held out as a whole, only blocks of it.
    """
    kinds = observation.kinds
    held = torch.zeros(len(kinds), dtype=torch.bool)
    for kind in sorted(set(kinds)):
        members = [n for n, each in enumerate(kinds) if each == kind]
        held[members[ONE_IN - 1 :: ONE_IN] or (members[1:2] if len(members) > 1 else [])] = True
    height, width = observation.size
    side = min(BLOCK, max(1, min(height, width) // 4))
    row = torch.arange(height)[:, None] // side
    column = torch.arange(width)[None] // side
    turn = torch.arange(len(kinds))[:, None, None]
    blocks = (row * 5 + column * 3 + turn * 7) % ONE_IN**2 == 0
    fitted = ~(blocks | held[:, None, None])
    if not fitted.any():
        raise BadInput(f"captures of {height} x {width} pixels: none is left to fit; expected at least 4 x 4 pixels")
    return Split(fitted, tuple(sorted(observation.number[held].tolist())), held)
