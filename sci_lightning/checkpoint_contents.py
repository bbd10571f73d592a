"""What a checkpoint may hold: checked on reading, before anything is made of it."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import torch
from annotated_types import Interval

from sci_lightning.bounds import Frames, Size
from sci_lightning.configuration.arguments import check_value
from sci_lightning.configuration.plain_data import check_plain_data
from sci_lightning.configuration.settings import check_field
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt

REQUIRED: Mapping[str, Any] = {
    "encoder": Mapping[str, Any],
    "decoder": Mapping[str, Any],
    "names": Mapping[str, str],
    "frames": Frames,
    "size": Size,
    "crop": Size,
    "seed": Annotated[int, Interval(ge=0, lt=2**63)],
}
"""The keys of a run's configuration that anything is read from, and their types."""

NAME = re.compile(r"[\w.+ -]{1,100}")
"""What an encoder or a decoder may be called: a name becomes part of messages, titles and file names."""


def check_run_config(path: Path, config: Mapping[str, Any]) -> None:
    """Check the configuration in a checkpoint: plain data, every key that is read there and of its type.

    Raises:
        BadInput: it is not; the message says which key, what it holds and what was expected.
    """
    check_plain_data(path, config)
    for key, kind in REQUIRED.items():
        if key not in config:
            raise BadInput(f"{path}: its configuration has no '{key}'; not a checkpoint of this version, or damaged")
        try:
            check_value(key, config[key], kind)
        except BadInput as error:
            raise BadInput(f"{path}: {error}") from error
    for part in ("encoder", "decoder"):
        name = config["names"].get(part)
        if name is None or not NAME.fullmatch(name):
            raise BadInput(f"{path}: names.{part}={excerpt(name)}: expected the name of the {part}")
    for section in (config, *_mappings(config["encoder"])):
        frames, size = section.get("frames"), section.get("size")
        if isinstance(frames, int) and _is_size(size):
            check_field(frames, size, f"{path}: ")


def check_state(path: Path, state: Mapping[Any, Any]) -> None:
    """Check that a state holds ordinary tensors by name, each backed by as many values as its shape says.

    A tensor of stride 0 takes four bytes in a file and declares any number of values.

    Raises:
        BadInput: it does not.
    """
    for name, tensor in state.items():
        if not isinstance(name, str) or not isinstance(tensor, torch.Tensor):
            kind = type(tensor).__name__
            raise BadInput(f"{path}: its state holds {excerpt(name)} of type {kind}, expected tensors by name")
        ordinary = tensor.layout is torch.strided and tensor.device.type == "cpu" and not tensor.is_quantized
        if not ordinary or tensor.numel() * tensor.element_size() > tensor.untyped_storage().nbytes():
            raise BadInput(f"{path}: '{excerpt(name)}' is not an ordinary tensor (its values are not in the file)")


def check_archive(path: Path) -> None:
    """Check the sizes and checksums of torch's archive; files of its format from before 2020 have none.

    Raises:
        BadInput: an entry that is compressed or larger than the file, or whose bytes are not those that were written.
    """
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
            raise BadInput(f"{path}: its entries are compressed, which torch.save never does; refused")
        if sum(entry.file_size for entry in entries) > path.stat().st_size:
            raise BadInput(f"{path}: declares more bytes than the file holds; damaged, or made to exhaust the memory")
        if damaged := archive.testzip():
            raise BadInput(f"{path}: damaged; the checksum of '{excerpt(damaged)}' is not that of its bytes")


def _is_size(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) == 2 and all(isinstance(side, int) for side in value)


def _mappings(content: Any) -> Iterator[Mapping[str, Any]]:
    if isinstance(content, Mapping):
        yield content
        content = list(content.values())
    if isinstance(content, (list, tuple)):
        for value in content:
            yield from _mappings(value)
