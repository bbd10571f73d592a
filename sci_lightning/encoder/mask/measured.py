"""Measured mask: read from a file that a calibration of the real modulator wrote."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from sci_lightning.configuration.bounds import ExistingPath, Frames, NonNegative, Positive, Size
from sci_lightning.encoder.mask.mask import Mask
from sci_lightning.errors import BadInput
from sci_lightning.files.mask_file import read_mask_file
from sci_lightning.files.stored_array import readable_shape


class Measured(Mask):
    """A mask read from a file and never changed.

    Args:
        file: .npy, .npz, .h5 or .hdf5 holding ``(T, H, W)``, .mat (any version) holding MATLAB's ``(H, W, T)``, a TIFF
            stack or a folder of pictures; see :func:`~sci_lightning.files.mask_file.read_mask_file`. None leaves the
            mask dark, to be filled from a checkpoint's state.
        frames, size: T and (H, W) that the rest of the run uses; the file must agree. None takes the file's.
        key: name of the array in a .mat, .npz or .h5 file; None takes ``mask``, else the only three-dimensional array.
        dark, white: numbers in the file that are transmittance 0 and 1; None: see
            :func:`~sci_lightning.files.mask_file.transmittance`.

    Raises:
        BadInput: the file is missing, unreadable, lacks the key, does not fit, or holds no transmittances.
    """

    def __init__(
        self,
        file: ExistingPath | None,
        frames: Frames | None = None,
        size: Size | None = None,
        key: str | None = None,
        dark: NonNegative | None = None,
        white: Positive | None = None,
    ) -> None:
        if file is not None:
            pattern = read_mask(file, key, field=size, frames=frames, dark=dark, white=white)
        elif frames is not None and size is not None:
            pattern = torch.zeros(frames, *size)
        else:
            raise BadInput("a measured mask needs a file: encoder.mask.file=MASK.mat (or .npy, .h5)")
        shape, wanted = tuple(pattern.shape), (frames or pattern.shape[0], *(size or pattern.shape[1:]))
        if shape != wanted:
            raise BadInput(
                f"{file}: the mask is {readable_shape(shape)} (T x H x W), the run needs {readable_shape(wanted)}; "
                f"set frames={shape[0]} 'size=[{shape[1]},{shape[2]}]' or give another file"
            )
        super().__init__(shape[0], shape[1:])
        self.register_buffer("pattern", pattern)

    @classmethod
    def of(cls, pattern: torch.Tensor) -> Measured:
        """Return the mask of a tensor ``(T, H, W)`` of transmittances.

        Raises:
            BadInput: another shape, or values outside of [0, 1].
        """
        if pattern.ndim != 3 or not pattern.is_floating_point() or not bool(((pattern >= 0) & (pattern <= 1)).all()):
            raise BadInput(
                f"mask {tuple(pattern.shape)} of {pattern.dtype}: expected transmittances (T, H, W), floating in [0, 1]"
            )
        mask = cls(None, pattern.shape[0], tuple(pattern.shape[1:]))
        mask.pattern = pattern.detach().float().clone()
        return mask

    @property
    def automatic_aperture(self) -> float:
        """1 over the mean of the mask's sum over time."""
        total = float(self.pattern.sum(0).mean())
        return 1 / total if total > 0 else 1.0


def read_mask(
    file: str | Path,
    key: str | None = None,
    setting: str = "encoder.mask.key",
    *,
    field: Sequence[int] | None = None,
    frames: int | None = None,
    dark: float | None = None,
    white: float | None = None,
) -> torch.Tensor:
    """Read a mask file into float32 ``(T, H, W)`` in [0, 1]; see :class:`Measured` for formats and errors.

    Args:
        file, key, dark, white: as of :class:`Measured`.
        setting: what the user sets to give ``key``, for the message; empty where it cannot be set.
        field, frames: (H, W) and T that the mask should have, if known; only the order of axes depends on them.
    """
    mask = read_mask_file(file, key, setting=setting, field=field, frames=frames, dark=dark, white=white)
    return torch.from_numpy(mask.astype("float32"))
