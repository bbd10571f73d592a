"""Snapshots that a camera took of known moving scenes, on which a decoder is tested."""

from __future__ import annotations

import numpy as np
import torch
from torch.utils.data import Dataset

from sci_lightning.captures import Captures
from sci_lightning.errors import BadInput
from sci_lightning.files.stored_array import readable_shape

HALF_A_LEVEL = 0.5 / 255
"""Patterns that differ by at most this count as the same: a modulator of 8 bits displays them alike."""


class CapturedSnapshots(Dataset[tuple[int, torch.Tensor, torch.Tensor, torch.Tensor]]):
    """Those of a camera's captures whose scene is known and moves and that were taken with a given mask.

    An item is ``(number, video (T, H, W), measurement (H, W) normalised by full scale, aperture ())``. Whether a scene
    moves is decided by its content, not by the label of the capture.

    Args:
        captures: of one camera.
        mask: ``(T, H, W)`` in [0, 1], the patterns that a capture must have been commanded to display, in this order;
            ``(T, Hm, Wm)`` of a modulator on a grid of its own.
        size: (H, W) of the field; None for the mask's.

    Raises:
        BadInput: the captures have another size or number of slots than the mask; no known scene moves; or none of
            the captures of moving scenes displayed the mask.
    """

    def __init__(self, captures: Captures, mask: torch.Tensor, size: tuple[int, int] | None = None) -> None:
        name, needed = captures.path or captures.name, "of a known scene that moves"
        taken, wanted = (captures.frames, *captures.size), (len(mask), *(size or mask.shape[1:]))
        displayed = (captures.frames, *captures.patterns.shape[1:])
        if taken != wanted or displayed != tuple(mask.shape):
            other = taken if taken != wanted else displayed
            mine = wanted if taken != wanted else tuple(mask.shape)
            raise BadInput(
                f"{name}: captures of {readable_shape(other)}, the mask is {readable_shape(mine)} (T x H x W); they "
                "must agree"
            )
        moving = [kind == "dynamic" for kind in captures.inferred_kind]
        if not any(moving):
            raise BadInput(f"{name}: none of its {len(captures)} captures is {needed} (kind dynamic)")
        expected = mask.detach().cpu().numpy()
        same = {
            tuple(sequence): bool(np.abs(captures.patterns[sequence] - expected).max() <= HALF_A_LEVEL)
            for sequence in np.unique(captures.sequence[moving], axis=0)
        }
        usable = [moves and same[tuple(slots)] for moves, slots in zip(moving, captures.sequence, strict=True)]
        if not any(usable):
            raise BadInput(
                f"{name}: none of its {sum(moving)} captures {needed} shows the encoder's mask, pattern by pattern; "
                "take them with the mask that the decoder was trained with"
            )
        self.captures = captures.take(usable)
        self.names = [f"capture_{index}" for index in np.flatnonzero(usable)]
        """Names made of the captures' numbers in the file, from 0."""

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, index: int) -> tuple[int, torch.Tensor, torch.Tensor, torch.Tensor]:
        measurement = self.captures.measurement[index].astype(np.float32) / self.captures.full_scale
        scene, aperture = self.captures.scene[index], self.captures.aperture[index]
        return index, torch.from_numpy(scene), torch.from_numpy(measurement), torch.tensor(aperture)
