"""The DAVIS 2017 data set at 480p, which video SCI networks are usually trained on."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sci_lightning.configuration.bounds import ExistingPath, Frames, Seed, Size
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
        frames, size, crop, seed, others: see :class:`~sci_lightning.data.stored_clips.StoredSource`.

    Raises:
        BadInput: a part of the data set is missing, or an argument is out of range. ``clips`` and
            ``scenes`` read the frames, and raise it for a sequence that is unreadable, too short or too small.
    """

    def __init__(
        self, root: ExistingPath, frames: Frames, size: Size, crop: Size, seed: Seed = 0, **others: Any
    ) -> None:
        super().__init__(frames, size, crop, seed, **others)
        folder = _locate(Path(root))
        self.training, self.held_out = (_sequences(folder, subset) for subset in ("train", "val"))


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
