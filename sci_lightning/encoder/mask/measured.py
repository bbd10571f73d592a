"""Measured mask: read from a file that a calibration of the real modulator wrote."""

from __future__ import annotations

from pathlib import Path

import torch

from sci_lightning.configuration.bounds import ExistingPath, Frames, Size
from sci_lightning.encoder.mask.mask import Mask
from sci_lightning.errors import BadInput
from sci_lightning.files.mask_file import read_mask_file
from sci_lightning.files.stored_array import readable_shape


class Measured(Mask):
    """A mask read from a file and never changed.

    Args:
        file: .npy, .h5 or .hdf5 holding ``(T, H, W)``, or .mat (version 5 or 7.3) holding MATLAB's ``(H, W, T)``;
            values in [0, 1]. None leaves the mask dark, to be filled from a checkpoint's state.
        frames, size: T and (H, W) that the rest of the run uses; the file must agree. None takes the file's.
        key: name of the array in a .mat or .h5 file; None takes ``mask``, else the only three-dimensional array.

    Raises:
        BadInput: the file is missing, unreadable, lacks the key, does not fit, or leaves [0, 1].
    """

    pattern: torch.Tensor

    def __init__(
        self,
        file: ExistingPath | None,
        frames: Frames | None = None,
        size: Size | None = None,
        key: str | None = None,
    ) -> None:
        if file is not None:
            pattern = read_mask(file, key)
        elif frames is not None and size is not None:
            pattern = torch.zeros(frames, *size)
        else:
            raise BadInput("a measured mask needs a file: encoder.mask.file=MASK.mat (or .npy, .h5)")
        shape, wanted = tuple(pattern.shape), (frames or pattern.shape[0], *(size or pattern.shape[1:]))
        if shape != wanted:
            raise BadInput(
                f"{file}: the mask is {readable_shape(shape)} (T x H x W), the run needs {readable_shape(wanted)}; "
                f"set frames={shape[0]} size=[{shape[1]},{shape[2]}] or give another file"
            )
        super().__init__(shape[0], shape[1:])
        self.register_buffer("pattern", pattern)

    @property
    def automatic_aperture(self) -> float:
        """1 over the mean of the mask's sum over time."""
        total = float(self.pattern.sum(0).mean())
        return 1 / total if total > 0 else 1.0

    def forward(self) -> torch.Tensor:
        return self.pattern


def read_mask(file: str | Path, key: str | None = None, setting: str = "encoder.mask.key") -> torch.Tensor:
    """Read a mask file into float32 ``(T, H, W)`` in [0, 1]; see :class:`Measured` for formats and errors.

    Args:
        file, key: as of :class:`Measured`.
        setting: what the user sets to give ``key``, for the message; empty where it cannot be set.
    """
    return torch.from_numpy(read_mask_file(file, key, setting=setting).astype("float32"))
