"""Masks as the code of the deep-optics paper publishes them, converted to those of this project."""

from __future__ import annotations

import torch
from torch.nn.functional import one_hot

from sci_lightning.encoder.mask.learned_structural import LearnedStructural
from sci_lightning.encoder.mask.mask import Mask
from sci_lightning.encoder.mask.measured import Measured
from sci_lightning.encoder.mask.structure import structure
from sci_lightning.errors import BadInput


def published_mask(levels: torch.Tensor, real: torch.Tensor | None, frames: int, size: tuple[int, int]) -> Mask:
    """Return the mask whose transmittance is exactly ``levels``.

    A structural mask becomes a learned one with the real-valued mask ``real``. The released code rounds halves to even,
    Algorithm 1 here rounds them up; at pixels where the two would give different levels, the real-valued mask is set to
    ``levels`` instead. Any other mask becomes a fixed one.

    Args:
        levels: ``(T, H, W)`` in [0, 1]; ``(T, H/2, W/2)`` of the prototype, whose values cover 2 x 2 pixels; or
            ``(H, W)``, the index of the one slot that is open.
        real: the real-valued mask in the same shape, or None.
        frames: T.
        size: (H, W).

    Raises:
        BadInput: a mask of another shape, or not in [0, 1].
    """
    if levels.ndim == 2 and levels.frac().eq(0).all() and levels.min() >= 0 and levels.max() < frames:
        levels, real = one_hot(levels.long(), frames).permute(2, 0, 1), None
    if levels.shape[1:] == (size[0] / 2, size[1] / 2):
        levels, real = _doubled(levels), None if real is None else _doubled(real)
    for name, part in (("encoder.weight", levels), ("continuous_mask", real)):
        if part is not None and part.shape != (frames, *size):
            raise BadInput(
                f"the mask in the file, '{name}', is {tuple(part.shape)}, expected {(frames, *size)} (T, H, W); "
                "set frames= and size= to the file's, or leave them out"
            )
    levels = levels.float()
    if not (levels.min() >= 0 and levels.max() <= 1):  # also false for NaN
        raise BadInput(
            f"the mask in the file, 'encoder.weight', ranges from {levels.min():g} to {levels.max():g}, "
            "expected transmittances in [0, 1]"
        )
    for bits in range(1, 9):
        if structure(levels, bits).equal(levels):
            learned = LearnedStructural(bits, frames, size)
            learned.weight.data.copy_(levels if real is None else _real_valued(levels, real.float().clamp(0, 1), bits))
            return learned
    fixed = Measured(None, frames, size)
    fixed.pattern.copy_(levels)
    return fixed


def _real_valued(levels: torch.Tensor, real: torch.Tensor, bits: int) -> torch.Tensor:
    return torch.where(structure(real, bits).eq(levels).all(0), real, levels)


def _doubled(mask: torch.Tensor) -> torch.Tensor:
    return mask.repeat_interleave(2, -2).repeat_interleave(2, -1)
