"""A folder of the user's own clips."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sci_lightning.configuration.bounds import Frames, Repeats, Seed, Share, Size
from sci_lightning.data.augmentation import Augmentation
from sci_lightning.data.reader import find_clips
from sci_lightning.data.source import Clips, Scene
from sci_lightning.data.store import ClipStore
from sci_lightning.data.stored_clips import StoredClips, stored_scenes
from sci_lightning.errors import BadInput


class Folder:
    """Any tree of clips: folders of images, ``.npz`` files, video files.

    Args:
        root: where the clips are; see :func:`~sci_lightning.data.reader.find_clips`.
        frames: T, the frames of one snapshot.
        size: ``(H, W)`` in pixels: the mask's full size, to which scenes are cut.
        crop: ``(h, w)`` in pixels: the size that is trained on.
        seed: decides the clips that are held out and all that is random in the training clips.
        val_root: where the held-out clips are; they are left out of training even if inside ``root``.
        validation: without ``val_root``, the share of the clips (between 0 and 1, at least one clip)
            that is held out.
        clips_per_epoch: by default the number of separate groups of T frames in the training clips.
        store: see :class:`~sci_lightning.data.store.ClipStore`.
        max_stride, reverse, scale, flip, rotate: see :class:`~sci_lightning.data.augmentation.Augmentation`.

    Raises:
        BadInput: there are no clips, or too few to hold one out, or an argument is out of range. Clips
            are opened by ``clips`` and ``scenes``, which raise it for one unreadable, short or small.
    """

    def __init__(
        self,
        root: str | Path,
        frames: Frames,
        size: Size,
        crop: Size,
        seed: Seed = 0,
        *,
        val_root: str | Path | None = None,
        validation: Share = 0.1,
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
        self.seed = seed
        self.clips_per_epoch = clips_per_epoch
        self.store = store
        self.augmentation = Augmentation(
            frames, crop, max_stride=max_stride, reverse=reverse, scale=scale, flip=flip, rotate=rotate
        )
        found = find_clips(root)
        self.held_out = find_clips(val_root) if val_root else _share(found, validation, seed, root)
        held_out = {clip.resolve() for clip in self.held_out}
        self.training = [clip for clip in found if clip.resolve() not in held_out]
        if not self.training:
            raise BadInput(f"{root}: every clip is in val_root={val_root} too; none is left to train on")

    def clips(self) -> Clips:
        """Augmented float32 ``(T, h, w)`` of all clips but the held-out."""
        store = ClipStore(self.training, self.store)
        return StoredClips(store, self.augmentation, seed=self.seed, clips_per_epoch=self.clips_per_epoch)

    def scenes(self) -> list[Scene]:
        """The held-out clips' centres, float32 ``(N, T, H, W)``, named after the clips."""
        return stored_scenes(ClipStore(self.held_out, self.store), self.frames, self.size)


def _share(clips: list[Path], share: float, seed: int, root: str | Path) -> list[Path]:
    """A seeded choice of clips: at least one, and at least one is left over."""
    if not 0 < share < 1:
        raise BadInput(f"validation={share}: must lie between 0 and 1")
    if len(clips) < 2:
        raise BadInput(f"{root}: holds a single clip, so none can be held out; give val_root for validation")
    count = min(max(1, round(share * len(clips))), len(clips) - 1)
    chosen = np.random.default_rng(seed).choice(len(clips), count, replace=False)
    return [clips[i] for i in sorted(chosen)]
