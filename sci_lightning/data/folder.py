"""A folder of the user's own clips."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sci_lightning.configuration.bounds import ExistingPath, Frames, Seed, Share, Size
from sci_lightning.data.reader import find_clips
from sci_lightning.data.source import Clips
from sci_lightning.data.stored_clips import StoredSource
from sci_lightning.data.synthetic import photographed_clips
from sci_lightning.errors import BadInput


class Folder(StoredSource):
    """Any tree of clips: folders of images, ``.npz`` files, video files, MATLAB and HDF5 files with frames.

    Args:
        root: the folder of the clips, or several; see :func:`~sci_lightning.data.reader.find_clips`.
        frames, size, crop, seed, others: see :class:`~sci_lightning.data.stored_clips.StoredSource`; the clips that are
            held out are the same for every seed.
        val_root: the folder of the held-out clips, which are not trained on even if they lie inside ``root``; a test
            on all clips of a folder names it twice.
        validation: without ``val_root``, the share of the clips (between 0 and 1, at least one clip) that is held out.
        photographs: a file of photographs that make up a part of the training clips, as those of
            :class:`~sci_lightning.data.synthetic.Synthetic`; None for none.
        photographs_share: that part, drawn clip by clip.

    Raises:
        BadInput: there are no clips, or an argument is out of range. ``clips`` and ``scenes`` read the clips, and raise
            it for one that is unreadable, too short or too small; ``clips`` also if all of them are held out.
    """

    def __init__(
        self,
        root: ExistingPath | Sequence[ExistingPath],
        frames: Frames,
        size: Size,
        crop: Size,
        seed: Seed = 0,
        *,
        val_root: ExistingPath | None = None,
        validation: Share = 0.1,
        photographs: ExistingPath | None = None,
        photographs_share: Share = 0.25,
        **others: Any,
    ) -> None:
        super().__init__(frames, size, crop, seed, **others)
        roots = [root] if isinstance(root, (str, Path)) else list(root)
        clips = list(dict.fromkeys(clip for one in roots for clip in find_clips(one)))
        self.held_out = find_clips(val_root) if val_root else _held_out_share(clips, validation)
        excluded = {clip.resolve() for clip in self.held_out}
        self.training = [clip for clip in clips if clip.resolve() not in excluded]
        self.root, self.val_root, self.crop = ", ".join(map(str, roots)), val_root, crop
        self.photographs, self.photographs_share = photographs, photographs_share

    @property
    def held_out_in_words(self) -> str:
        """Which clips are held out, in words; empty where ``val_root`` names them."""
        if self.val_root:
            return ""
        names = [clip.name for clip in self.held_out]
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        return (
            f"kept for validation, not trained on: {', '.join(names[:3])}{more}, {len(names)} of "
            f"{len(names) + len(self.training)} clips; data.val_root=FOLDER names others"
        )

    def clips(self) -> Clips:
        """Return augmented training clips, among them those made of photographs, float32 ``(T, h, w)`` in [0, 1]."""
        if not self.training:
            one = "holds a single clip, so none can be held out; give data.val_root=FOLDER for validation"
            every = f"every clip is in val_root={self.val_root} too; none is left to train on"
            raise BadInput(f"{self.root}: {every if self.val_root else one}")
        clips = super().clips()
        if self.photographs is None:
            return clips
        made = photographed_clips(self.photographs, self.frames, self.crop, self.seed, len(clips))
        return MixedClips(clips, made, self.photographs_share, self.seed)


class MixedClips(Clips):
    """Clips of one stream, and in place of a part of them, drawn clip by clip, those of another."""

    def __init__(self, clips: Clips, others: Clips, share: float, seed: int) -> None:
        self.clips, self.others, self.share, self.seed = clips, others, share, seed

    def __len__(self) -> int:
        return len(self.clips)

    def __getitem__(self, index: int) -> torch.Tensor:
        if index < 0:
            raise IndexError(f"clip {index}: the stream of clips starts at 0")
        other = np.random.default_rng((self.seed, index, 1)).random() < self.share
        return self.others[index] if other else self.clips[index]


def _held_out_share(clips: list[Path], share: float) -> list[Path]:
    """Draw the clips to hold out: at least one, and where there are several at least one is left to train on.

    They do not depend on the seed of a training: a test with another seed would fall on clips that were trained on.
    """
    if not 0 < share < 1:
        raise BadInput(f"validation={share}: must lie between 0 and 1")
    count = max(1, min(round(share * len(clips)), len(clips) - 1))
    drawn = np.random.default_rng(0).choice(len(clips), count, replace=False)
    return [clips[i] for i in sorted(drawn)]
