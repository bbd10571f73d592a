"""Training clips and test scenes from a store of decoded clips."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from sci_lightning.configuration.bounds import Frames, Repeats, Seed, Size
from sci_lightning.data.augmentation import Augmentation
from sci_lightning.data.source import Clips, Scene
from sci_lightning.data.store import ClipStore
from sci_lightning.errors import BadInput


class StoredClips(Clips):
    """Augmented training clips from a :class:`ClipStore`.

    A clip is drawn with a probability in proportion to its length, and then augmented.

    Args:
        store: the decoded clips.
        augmentation: makes float32 ``(T, h, w)`` in [0, 1] of a stored clip.
        seed: decides, together with the index of a training clip, what is drawn.
        clips_per_epoch: ``len``; by default the number of separate groups of T frames in the store.

    Raises:
        BadInput: a clip is too short or too small for the augmentation, or an argument is out of range.
    """

    def __init__(
        self,
        store: ClipStore,
        augmentation: Augmentation,
        *,
        seed: int = 0,
        clips_per_epoch: int | None = None,
    ) -> None:
        for clip, shape in zip(store.clips, store.shapes, strict=True):
            augmentation.check(shape, clip)
        self.store = store
        self.augmentation = augmentation
        self.seed = seed
        self._groups_up_to = np.cumsum([length // augmentation.frames for length, _, _ in store.shapes])
        self._length = int(self._groups_up_to[-1]) if clips_per_epoch is None else clips_per_epoch
        if self._length < 1:
            raise BadInput(f"clips_per_epoch={clips_per_epoch}: must be at least 1")

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: int) -> torch.Tensor:
        if index < 0:
            raise IndexError(f"clip {index}: the stream of clips starts at 0")
        random = np.random.default_rng((self.seed, index))
        group = random.integers(self._groups_up_to[-1])
        clip = int(np.searchsorted(self._groups_up_to, group, side="right"))
        return self.augmentation(self.store[clip], random)


class StoredSource:
    """The part that all sources of files have in common: clips to train on and held-out scenes, decoded into a store.

    A subclass says which clips these are: in ``training`` and ``held_out``, lists of files or folders.

    Args:
        frames: T, the number of frames in one snapshot.
        size: ``(H, W)`` in pixels, the mask's full size, to which scenes are cut.
        crop: ``(h, w)`` in pixels, the size of training clips.
        seed: decides all that is random in the training clips.
        clips_per_epoch: by default the number of separate groups of T frames in the training clips.
        store: see :class:`~sci_lightning.data.store.ClipStore`.
        max_stride, reverse, scale, flip, rotate: see :class:`~sci_lightning.data.augmentation.Augmentation`.

    Raises:
        BadInput: an argument is out of range.
    """

    training: list[Path]
    held_out: list[Path]

    def __init__(
        self,
        frames: Frames,
        size: Size,
        crop: Size,
        seed: Seed = 0,
        *,
        clips_per_epoch: Repeats | None = None,
        store: str | Path | None = None,
        max_stride: Repeats = 2,
        reverse: bool = True,
        scale: Sequence[float] = (0.75, 2.0),
        flip: bool = True,
        rotate: bool = True,
    ) -> None:
        self.frames = frames
        self.size = size
        self.augmentation = Augmentation(
            frames, crop, max_stride=max_stride, reverse=reverse, scale=scale, flip=flip, rotate=rotate
        )
        self.seed = seed
        self.clips_per_epoch = clips_per_epoch
        self.store = store

    def clips(self) -> Clips:
        """Return augmented training clips, float32 ``(T, h, w)`` in [0, 1]."""
        store = ClipStore(self.training, self.store)
        return StoredClips(store, self.augmentation, seed=self.seed, clips_per_epoch=self.clips_per_epoch)

    def scenes(self) -> list[Scene]:
        """Return the centres of the held-out clips, float32 ``(N, T, H, W)`` in [0, 1], named after the clips."""
        return stored_scenes(ClipStore(self.held_out, self.store), self.frames, self.size)

    def colour_scenes(self) -> list[Scene]:
        """Return the same scenes in colour, ``(N, 3, T, H, W)``."""
        return stored_scenes(ClipStore(self.held_out, self.store, colour=True), self.frames, self.size)


class StoredVideo:
    """The centre of one stored clip, read group by group, so that a scene takes no memory until it is used."""

    def __init__(
        self, store: ClipStore, clip: int, frames: int, corner: tuple[int, int], size: tuple[int, int]
    ) -> None:
        self.store = store
        self.clip = clip
        self.frames = frames
        self.window = tuple(slice(start, start + side) for start, side in zip(corner, size, strict=True))

    def __len__(self) -> int:
        return self.store.shapes[self.clip][0] // self.frames

    def __getitem__(self, index: int) -> torch.Tensor:
        group = range(len(self))[index]  # an index out of range raises IndexError, as in a list
        planes = (3 if self.store.colour else 1) * self.frames
        rows, columns = self.window
        part = self.store[self.clip][group * planes : (group + 1) * planes, rows, columns]
        video = torch.from_numpy(np.array(part)).float().div_(255)
        return video.unflatten(0, (self.frames, 3)).movedim(1, 0) if self.store.colour else video


def stored_scenes(store: ClipStore, frames: int, size: Sequence[int]) -> list[Scene]:
    """Return the centres of all clips as scenes of whole groups of T frames, named after the clips.

    Args:
        store: the decoded clips.
        frames: T; remaining frames at a clip's end are dropped.
        size: ``(H, W)`` in pixels, cut from the centre.

    Raises:
        BadInput: a clip is shorter than ``frames`` or smaller than ``size``.
    """
    height, width = size
    scenes = []
    for index, name in enumerate(_scene_names(store.clips)):
        length, rows, columns = store.shapes[index]
        if length < frames or rows < height or columns < width:
            raise BadInput(
                f"{store.clips[index]}: {length} frames of {rows} x {columns} pixels; "
                f"a scene needs {frames} or more of at least {height} x {width}"
            )
        top, left = (rows - height) // 2, (columns - width) // 2
        scenes.append(Scene(name, StoredVideo(store, index, frames, (top, left), (height, width))))
    return scenes


def _scene_names(clips: Sequence[Path]) -> list[str]:
    """Return the names of the clips; where several have the same name, with the folders in which they differ."""
    names = [clip.name if clip.is_dir() else clip.stem for clip in clips]
    count = Counter(names)
    root = os.path.commonpath(clips)
    return [
        name if count[name] == 1 else "-".join(clip.relative_to(root).parts)
        for name, clip in zip(names, clips, strict=True)
    ]
