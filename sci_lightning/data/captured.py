"""Snapshots that a camera took of known scenes in motion, to test a decoder on."""

from __future__ import annotations

import numpy as np
import torch
from torch.utils.data import Dataset

from sci_lightning.captures import Captures
from sci_lightning.errors import BadInput

HALF_A_LEVEL = 0.5 / 255
"""Patterns that differ by no more are the same: a modulator of 8 bits shows them alike."""


class CapturedSnapshots(Dataset[tuple[int, torch.Tensor, torch.Tensor, torch.Tensor]]):
    """The captures of known, moving scenes behind one mask.

    Item: ``(number, video (T, H, W), measurement (H, W) normalised by full scale, aperture ())``. A capture is dynamic
    by its content, whatever its label says.

    Args:
        captures: of one camera.
        mask: ``(T, H, W)`` in [0, 1], the patterns that the captures must have been told to show, in this order.

    Raises:
        BadInput: another size or number of slots than the mask's; none with a known scene that moves; none of those
            was told to show the mask.
    """

    def __init__(self, captures: Captures, mask: torch.Tensor) -> None:
        name, needed = captures.path or captures.name, "of a known scene that moves"
        taken = (captures.frames, *captures.size)
        if taken != tuple(mask.shape):
            raise BadInput(
                f"{name}: captures of {_times(taken)}, the mask is {_times(mask.shape)} (T x H x W); they must agree"
            )
        moving = [kind == "dynamic" for kind in captures.inferred_kind]
        if not any(moving):
            raise BadInput(f"{name}: none of its {len(captures)} captures is {needed} (kind dynamic)")
        told = mask.detach().cpu().numpy()
        same = {
            tuple(sequence): bool(np.abs(captures.patterns[sequence] - told).max() <= HALF_A_LEVEL)
            for sequence in np.unique(captures.sequence[moving], axis=0)
        }
        chosen = [moves and same[tuple(each)] for moves, each in zip(moving, captures.sequence, strict=True)]
        if not any(chosen):
            raise BadInput(
                f"{name}: none of its {sum(moving)} captures {needed} shows the encoder's mask, pattern by pattern; "
                "take them with the mask that the decoder was trained with"
            )
        self.captures = captures.take(chosen)
        self.names = [f"capture_{index}" for index in np.flatnonzero(chosen)]
        """After the captures' numbers in the file, from 0."""

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, index: int) -> tuple[int, torch.Tensor, torch.Tensor, torch.Tensor]:
        measurement = self.captures.measurement[index].astype(np.float32) / self.captures.full_scale
        scene, aperture = self.captures.scene[index], self.captures.aperture[index]
        return index, torch.from_numpy(scene), torch.from_numpy(measurement), torch.tensor(aperture)


def _times(shape: tuple[int, ...]) -> str:
    return " x ".join(str(side) for side in shape)
