"""Small files of strangers: read whole, within a bound, and only where there is a file to be read."""

from __future__ import annotations

from pathlib import Path

from sci_lightning.errors import BadInput


def read_bounded(path: Path, largest: int, what: str) -> bytes:
    """Return the content of a file.

    Args:
        path: of the file.
        largest: bytes that are read at most.
        what: what is larger than that in no case, for the message: ``no metrics of a run``.

    Raises:
        BadInput: no regular file (a pipe or a device would wait for ever), not readable, or larger.
    """
    if not path.is_file():
        raise BadInput(f"{path}: {'not a readable file' if path.exists() else 'no such file'}")
    try:
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({(error.strerror or str(error)).lower()})") from error
    if len(content) > largest:
        raise BadInput(f"{path}: larger than {largest:,} bytes, which {what} is")
    return content
