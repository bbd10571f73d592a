"""Trained weights that come along with the package: ``NAME.safetensors``, and ``NAME.md``, its model card.

A file is a checkpoint without a training's progress, in float16. That of a decoder's own name holds what the decoder
learns: ``decoder=universal`` needs no training.
"""

from __future__ import annotations

from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import Checkpoint, read_checkpoint

FOLDER = Path(__file__).parent

BEST = "universal"
"""The weights that decode behind any mask."""

ANY_MASK = "any mask"
"""What the encoder is called of weights that were trained behind many masks: theirs says nothing about a snapshot's."""


def shipped() -> list[str]:
    """Return the names of the weights that come along."""
    return sorted(file.stem for file in FOLDER.glob("*.safetensors"))


def weights_file(source: str | Path) -> Path:
    """Return the file of weights that come along, by their name, or the one at a path.

    Raises:
        BadInput: no such name and no such file.
    """
    if str(source) in shipped():
        return FOLDER / f"{source}.safetensors"
    if not Path(source).is_file():
        names = ", ".join(shipped())
        raise BadInput(f"weights={source}: no such file; give its path, or one of those that come along: {names}")
    return Path(source)


def load_weights(source: str | Path) -> Checkpoint:
    """Return a trained decoder, and the encoder that it was trained behind, of weights that come along or of a file.

    >>> import sci_lightning as sci
    >>> decoder = sci.load_weights("universal").decoder()  # decoder(measurement, mask) -> video

    Args:
        source: the name of weights that come along, such as ``universal``, or the path of a checkpoint.

    Raises:
        BadInput: no such weights, or a file that is no checkpoint; nothing in a file is executed.
    """
    return read_checkpoint(weights_file(source))
