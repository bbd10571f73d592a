"""What travels from a machine that is lost after its lease: one ZIP archive in files of at most 16 MiB."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.studies.relay.relay_queue import inner_path

PART = 16 * 2**20
"""Bytes of a file of the archive at most."""
PARTS = "relay.zip."
"""Its files are called relay.zip.0, relay.zip.1, .."""
LARGEST = 64 * 2**20
"""Bytes of the archive that is read."""


def pack(files: Mapping[str, Path], folder: Path) -> None:
    """Write files into an archive in parts.

    Args:
        files: by their names in the archive.
        folder: of the parts, which replace those of an earlier archive.
    """
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, path in files.items():
            archive.write(path, name)
    whole = content.getvalue()
    starts = range(0, len(whole), PART)
    for number, start in enumerate(starts):
        with atomic_write(folder / f"{PARTS}{number}") as temporary:
            temporary.write_bytes(whole[start : start + PART])
    for path in folder.glob(f"{PARTS}*"):
        if path.name not in {f"{PARTS}{number}" for number in range(len(starts))}:
            path.unlink()


def unpack(folder: Path) -> dict[str, bytes]:
    """Return the content of every file of an archive by its name; what is damaged or leads elsewhere is refused.

    Raises:
        BadInput: no archive, one that is damaged or larger than a lease leaves, or a name that leads elsewhere.
    """
    paths = [folder / f"{PARTS}{number}" for number in range(LARGEST // PART)]
    paths = [path for path in paths if path.is_file() and path.stat().st_size <= PART]
    if not paths:
        raise BadInput(f"{folder}: holds no {PARTS}0, which a lease with archive= leaves")
    try:
        with zipfile.ZipFile(io.BytesIO(b"".join(path.read_bytes() for path in paths))) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > 2 * LARGEST:
                raise BadInput(f"{folder}: larger than what a lease leaves")
            return {str(inner_path(name)): archive.read(name) for name in archive.namelist()}
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, RuntimeError) as error:  # of these: encrypted
        raise BadInput(f"{folder}: a part of the archive is missing or damaged ({error})") from error
