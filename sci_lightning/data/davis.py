"""The DAVIS 2017 data set at 480p, which video SCI networks are usually trained on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from sci_lightning.configuration.bounds import ExistingPath, Frames, Repeats, Seed, Size
from sci_lightning.data.augmentation import Augmentation
from sci_lightning.data.stored_clips import StoredSource
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt

NAME = re.compile(r"\w[\w.-]{0,99}", re.ASCII)
"""Names of sequences: a folder beside the others, never a path that leads elsewhere."""


class Davis(StoredSource):
    """DAVIS 2017: the ``train`` sequences are the training clips, the ``val`` sequences the held-out scenes.

    Source: Pont-Tuset et al., "The 2017 DAVIS Challenge on Video Object Segmentation", arXiv:1704.00675.

    Args:
        root: the folder that holds ``JPEGImages/480p/<sequence>/*.jpg`` and
            ``ImageSets/2017/{train,val}.txt``, or the folder above it.
        frames: T, the number of frames in one snapshot.
        size: ``(H, W)`` in pixels, the mask's full size, to which scenes are cut.
        crop: ``(h, w)`` in pixels, the size of training clips.
        seed: decides all that is random in the training clips.
        clips_per_epoch: by default the number of separate groups of T frames in the training sequences.
        store: see :class:`~sci_lightning.data.store.ClipStore`.
        max_stride, reverse, scale, flip, rotate: see :class:`~sci_lightning.data.augmentation.Augmentation`.

    Raises:
        BadInput: a part of the data set is missing, or an argument is out of range. ``clips`` and
            ``scenes`` read the frames, and raise it for a sequence that is unreadable, too short or too small.
    """

    def __init__(
        self,
        root: ExistingPath,
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
        augmentation = Augmentation(
            frames, crop, max_stride=max_stride, reverse=reverse, scale=scale, flip=flip, rotate=rotate
        )
        folder = _locate(Path(root))
        training, held_out = (_sequences(folder, subset) for subset in ("train", "val"))
        super().__init__(
            training,
            held_out,
            frames,
            size,
            augmentation,
            seed=seed,
            clips_per_epoch=clips_per_epoch,
            store=store,
        )


def _locate(root: Path) -> Path:
    """Return the folder of the data set: ``root``, or the first folder in it that holds the frames."""
    for folder in (root, *sorted(root.glob("*/"))):
        if (folder / "JPEGImages" / "480p").is_dir():
            return folder
    raise BadInput(f"{root}: neither it nor a folder in it holds JPEGImages/480p; give the DAVIS 2017 folder")


def _sequences(folder: Path, subset: str) -> list[Path]:
    """Return the folders of the sequences that the list of a subset, ``train`` or ``val``, names."""
    names = folder / "ImageSets" / "2017" / f"{subset}.txt"
    if not names.is_file():
        raise BadInput(f"{names}: no such file; it lists the {subset} sequences of DAVIS 2017")
    try:
        listed = names.read_text().split()
    except ValueError as error:
        raise BadInput(f"{names}: not text; it should list the {subset} sequences of DAVIS 2017") from error
    for name in listed:
        if not NAME.fullmatch(name):
            raise BadInput(f"{names}: '{excerpt(name)}' is no name of a sequence; expected such as 'bmx-bumps'")
    sequences = [folder / "JPEGImages" / "480p" / name for name in listed]
    if not sequences:
        raise BadInput(f"{names}: is empty; it should list the {subset} sequences of DAVIS 2017")
    for sequence in sequences:
        if not sequence.is_dir():
            raise BadInput(f"{sequence}: no such folder, though {names} lists it; is DAVIS unpacked whole?")
    return sequences
