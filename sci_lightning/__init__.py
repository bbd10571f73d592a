"""Design, train and trust a video snapshot compressive imaging camera."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sci_lightning.runs.checkpoint import Checkpoint

__all__ = ["__version__", "load_checkpoint"]

try:
    __version__ = version("sci-lightning")
except PackageNotFoundError:  # running from a checkout that was never installed
    __version__ = "0+unknown"


def load_checkpoint(path: str | Path, trusted: Iterable[str] = ()) -> Checkpoint:
    """Read what a training run left, for a notebook: ``load_checkpoint(path).encoder()`` and ``.decoder()``.

    Both are plain ``torch.nn.Module`` objects with the trained weights; nothing in the file is executed.

    Args:
        path: RUN/checkpoints/last.ckpt, or a file that ``convert`` wrote.
        trusted: packages beside this one whose classes the file may name.

    Raises:
        BadInput: missing, damaged or not a checkpoint of this project.
    """
    from sci_lightning.runs.checkpoint import read_checkpoint  # torch is loaded when it is needed

    return read_checkpoint(path, trusted)
