"""Mask orientation: the modulator is mounted mirrored or turned."""

from __future__ import annotations

from collections.abc import Callable

import torch

from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.encoder.effects.stage import ModulatorEffect
from sci_lightning.errors import BadInput

OPERATIONS: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "flip_lr": lambda x: x.flip(-1),
    "flip_ud": lambda x: x.flip(-2),
    "rot90": lambda x: x.rot90(1, (-2, -1)),
    "rot180": lambda x: x.rot90(2, (-2, -1)),
    "rot270": lambda x: x.rot90(3, (-2, -1)),
    "transpose": lambda x: x.transpose(-1, -2),
    "antitranspose": lambda x: x.rot90(2, (-2, -1)).transpose(-1, -2),
}
UPRIGHT = ("flip_lr", "flip_ud", "rot180")


class MaskOrientation(ModulatorEffect):
    """The patterns are displayed mirrored or turned; a quarter turn is counter-clockwise on the screen, as in NumPy.

    Args:
        operation: identity, flip_lr, flip_ud, rot90, rot180, rot270, transpose or antitranspose (about the other
            diagonal). All but the flips and rot180 need square patterns.

    Raises:
        BadInput: patterns that are not square, when they must be.
    """

    name = "mask_orientation"
    rank = 11
    about = {"operation": Parameter("", "identity", choices=("identity", *OPERATIONS))}
    sentence = "the mask's image is turned or mirrored ({operation})"
    operation: str

    @classmethod
    def starts(cls, frames: int, size: tuple[int, int], bit_depth: int) -> list[dict[str, Value]]:
        square = size[0] == size[1]
        return [{"operation": word} for word in OPERATIONS if square or word in UPRIGHT]

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        if self.operation == "identity":
            return patterns
        if patterns.shape[-1] != patterns.shape[-2] and self.operation not in UPRIGHT:
            raise BadInput(
                f"mask_orientation.operation={self.operation} needs square patterns, these are "
                f"{tuple(patterns.shape[-2:])}; choose one of {', '.join(UPRIGHT)}"
            )
        return OPERATIONS[self.operation](patterns)
