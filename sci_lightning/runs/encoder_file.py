"""An encoder in a file outside of ``conf/``, such as the ``encoder.yaml`` of a diagnosis: read and checked."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sci_lightning.configuration.arguments import check_value
from sci_lightning.configuration.bounds import Frames, Size
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_data import check_plain_data
from sci_lightning.files.yaml_file import read_yaml
from sci_lightning.plain_text import excerpt

REFERENCES = {"frames": "${frames}", "size": "${size}", "seed": "${seed}"}
"""The references to the run's own settings that an encoder file may hold, by the key that may hold them."""

KEY = re.compile(r"_target_|[A-Za-z][A-Za-z0-9_]*", re.ASCII)
"""Keys of an encoder file. Hydra obeys some others: ``defaults`` mounts further files, ``_args_`` passes arguments, and
``encoder@hydra`` moves what it stands for."""

FIELD = {"frames": Frames, "size": Size}
"""The types of what an encoder file says of the field."""

RESERVED = ("defaults", "hydra")


@dataclass(frozen=True)
class EncoderFile:
    """An encoder file that was read and checked.

    Attributes:
        path: of the file.
        content: plain data; relative ``file:`` entries are joined with the file's own folder.
    """

    path: Path
    content: dict[str, Any]

    def field(self) -> dict[str, Any]:
        """``frames`` of its mask and ``size`` of its field, as far as the file or the mask file that it names says."""
        mask = self.content.get("mask")
        if not isinstance(mask, Mapping):
            return {}
        known = {key: mask[key] for key in ("frames", "size") if mask.get(key) not in (None, REFERENCES[key])}
        if len(known) < 2 and isinstance(file := mask.get("file"), str) and file != "???":
            from sci_lightning.encoder.mask.measured import read_mask

            frames, *size = read_mask(file, mask.get("key"), dark=mask.get("dark"), white=mask.get("white")).shape
            known = {"frames": frames, "size": size, **known}
        if self.content.get("sensor_to_modulator") is not None:  # the mask's size is that of the modulator
            known.pop("size", None)
            field = self.content.get("size")
            known |= {} if field in (None, REFERENCES["size"]) else {"size": field}
        for key, value in known.items():
            check_value(f"{self.path}: encoder.mask.{key}", value, FIELD[key])
        return known


def read_encoder_file(path: Path) -> EncoderFile:
    """Read an encoder file and check that it holds plain data and the known references, before anything uses it.

    Raises:
        BadInput: it is missing, is no YAML, does not describe one object or holds more than plain data.
    """
    if not path.is_file():
        raise BadInput(f"{path}: no such encoder file; give the encoder.yaml of a diagnosis, or a name such as lsw_sr")
    content = read_yaml(path)
    if not isinstance(content, dict) or "_target_" not in content:
        raise BadInput(f"{path}: not an encoder; expected a mapping with _target_: sci_lightning.encoder.Encoder")
    check_plain_data(path, content, REFERENCES)
    return EncoderFile(path, _anchored(content, path, path.resolve().parent, bound=True))


def checked_encoder(path: Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """The encoder's configuration in a checkpoint, checked as that of an encoder file; raises BadInput."""
    check_plain_data(path, content)
    return dict(_anchored(dict(content), path, Path()))


def _anchored(content: Any, path: Path, folder: Path, bound: bool = False) -> Any:
    """``content`` with its keys checked and relative ``file:`` entries taken from ``folder``.

    ``bound``: they have to lie in it. An encoder file may be a stranger's, and what it names is read.
    """
    if isinstance(content, list):
        return [_anchored(value, path, folder, bound) for value in content]
    if not isinstance(content, dict):
        return content
    for key in content:
        if not KEY.fullmatch(key) or key in RESERVED:
            raise BadInput(f"{path}: the key '{key}' has no place in an encoder file")
    return {
        key: _file(value, path, folder, bound)
        if key == "file" and isinstance(value, str) and value != "???"
        else _anchored(value, path, folder, bound)
        for key, value in content.items()
    }


def _file(name: str, path: Path, folder: Path, bound: bool) -> str:
    if not name.isprintable():
        raise BadInput(f"{path}: file: {excerpt(name)} is no name of a file; expected printable text")
    file = folder / os.path.expanduser(name)
    if bound and not os.path.realpath(file).startswith(os.path.join(os.path.realpath(folder), "")):
        raise BadInput(
            f"{path}: file: {excerpt(name)} lies outside of the encoder file's folder; copy it into {folder}, or name "
            "it on the command line, as in encoder.mask.file=MASK.mat"
        )
    return str(file)
