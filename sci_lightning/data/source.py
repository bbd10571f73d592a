"""The interface of all sources of video: clips to train on, scenes to test on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from torch.utils.data import Dataset


class Snapshots(Protocol):
    """N consecutive groups of T frames: a float32 ``(N, T, H, W)`` tensor, or anything that is read like one."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> torch.Tensor:
        """Return group number ``index``, float32 ``(T, H, W)`` in [0, 1]."""
        ...


@dataclass(frozen=True)
class Scene:
    """One named test video, cut into snapshots of T frames.

    Attributes:
        name: the scene's name as it appears in tables and in ``metrics.json``.
        video: its groups of T frames, in order.
    """

    name: str
    video: Snapshots


class Clips(Dataset[torch.Tensor]):
    """An endless, seeded stream of training clips that is cut into epochs.

    ``clips[i]`` is float32 ``(T, h, w)`` in [0, 1] for *every* ``i >= 0``: a pure function of the
    seed and ``i``, so that epoch ``e`` is simply the indices ``e * len(clips)`` onwards and a resumed
    run draws the clips that the interrupted one would have drawn. ``len(clips)`` is the number of
    clips that make an epoch.
    """

    def __len__(self) -> int:
        raise NotImplementedError

    def __getitem__(self, index: int) -> torch.Tensor:
        raise NotImplementedError


@runtime_checkable
class Source(Protocol):
    """A source of video.

    One that has ``colour_scenes()`` as well returns its scenes in red, green and blue, ``(N, 3, T, H, W)``, by it.
    Both methods raise :class:`~sci_lightning.errors.BadInput` if the source has no such clips or scenes.
    """

    def clips(self) -> Clips:
        """Return training clips of T frames, cropped to the training size and augmented."""
        ...

    def scenes(self) -> list[Scene]:
        """Return held-out scenes at the mask's full size, never used for training and never augmented."""
        ...
