"""``encoder=PATH/encoder.yaml``, ``decoder.camera=PATH/encoder.yaml``: an encoder that lies outside ``conf/``."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, cast

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf, open_dict

from sci_lightning.cli.composition import group_members
from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import check_fields
from sci_lightning.files.plain_data import check_plain_data
from sci_lightning.files.stored_array import readable_shape
from sci_lightning.runs.encoder_file import EncoderFile, read_encoder_file

PLACES = {"encoder": "encoder", "decoder.camera": "encoder@camera"}
"""What the command line says, and what Hydra calls it."""

FROM_FILE = "from_file"
"""The key under which a node says which file it was read from, until the configuration is adapted to it."""


def adopt_encoder_files(arguments: Iterable[str]) -> list[str]:
    """Make every encoder file that the arguments name a member of the group ``encoder``, at either of its places.

    The member lives in Hydra's store in memory, where multiruns and launchers find it, and is called after its file, or
    after the folder of a file called ``encoder.yaml``. Relative ``file:`` entries are taken from the file's own folder.

    Args:
        arguments: of the command line; ``encoder=a.yaml,b.yaml,lsw_sr`` is a sweep.

    Returns:
        the arguments with names in the place of paths, as Hydra takes them.

    Raises:
        BadInput: a file that is missing, is no YAML, does not describe one object or holds more than plain data.
    """
    taken = set(group_members("encoder"))

    def member(value: str) -> str:
        bare = value.strip().strip("'\"")
        if not bare.endswith(".yaml"):
            if "/" in bare:
                _refuse_path(Path(os.path.expanduser(bare)))
            return value
        file = read_encoder_file(Path(os.path.expanduser(bare)))
        name = _name(file.path.resolve(), taken)
        taken.add(name)
        node = OmegaConf.create({**file.content, FROM_FILE: str(file.path)})
        ConfigStore.instance().store(group="encoder", name=name, node=node)
        return f"'{name}'"

    adopted = []
    for argument in arguments:
        key, equals, value = argument.partition("=")
        bare = key.lstrip("+")
        if equals and bare in PLACES:
            group = key.replace(bare, PLACES[bare])
            argument = f"{group}={','.join(map(member, _members(value)))}"
        adopted.append(argument)
    return adopted


def _members(value: str) -> list[str]:
    """Split a sweep over encoders at its commas; those of a path in quotes, or of a file that exists, are its own."""
    if os.path.isfile(os.path.expanduser(value)):
        return [value]
    return re.findall(r"'[^']*'|\"[^\"]*\"|[^,]+", value) or [value]


def _refuse_path(path: Path) -> None:
    """Raise BadInput for a path that names no encoder file; a name of a member with folders in it is none."""
    if path.is_dir():
        raise BadInput(f"{path}: is a folder; give the encoder file in it: {path / 'encoder.yaml'}")
    if path.is_file():
        raise BadInput(f"{path}: is no encoder file, whose name ends with .yaml; give the encoder.yaml of a diagnosis")


def adapt_to_encoder_files(cfg: DictConfig, overrides: Iterable[str], trusted: Iterable[str]) -> None:
    """Fit a composed configuration to the encoder files in it.

    ``frames`` and ``size`` are the file's unless the command line says otherwise. Then every ``_target_`` is checked,
    and what was checked takes the place of the node, resolved: nothing is left in it that could still change.

    Args:
        cfg: of the command; nodes that come from a file say so, see :data:`FROM_FILE`.
        overrides: of the command line, as Hydra takes them.
        trusted: packages beside this one whose classes a file may name.

    Raises:
        BadInput: files or settings that contradict each other, or a class that the file may not name.
    """
    files: dict[str, EncoderFile] = {}
    for group in PLACES.values():
        key = group.rpartition("@")[2]
        if OmegaConf.is_config(node := cfg.get(key)) and FROM_FILE in node:
            with open_dict(node):
                path = Path(node.pop(FROM_FILE))
            content = {str(name): value for name, value in cast("dict[Any, Any]", OmegaConf.to_container(node)).items()}
            files[key] = EncoderFile(path, content)
    if not files:
        return
    from sci_lightning.configuration.registry import check_targets

    given = {override.lstrip("+").partition("=")[0] for override in overrides}
    fitted: dict[str, tuple[Any, Path]] = {}
    for file in files.values():
        known = file.field()
        for key, value in known.items():
            if key not in cfg:
                continue
            wanted, other = fitted.get(key, (cfg[key], None))
            if (key in given or other) and wanted != value:
                shape = readable_shape((known.get("frames"), *(known.get("size") or ())))
                raise BadInput(
                    f"{file.path}: the encoder is {shape} (T x H x W), {other or 'the command line'} asks for "
                    f"{key}={_compact(wanted)}; set frames={known.get('frames')} 'size={_compact(known.get('size'))}' "
                    "or give another file"
                )
            cfg[key] = value
            fitted[key] = (value, file.path)
    for key, file in files.items():
        settings = OmegaConf.to_container(cfg[key], resolve=True)
        check_plain_data(file.path, settings)
        check_targets(file.path, settings, trusted)
        check_fields(settings, f"{file.path}: ")
        cfg[key] = settings


def _compact(value: Any) -> str:
    return str(list(value) if isinstance(value, Iterable) else value).replace(" ", "")


def _name(path: Path, taken: set[str]) -> str:
    stem = path.parent.name if path.stem == "encoder" else path.stem
    name = stem = re.sub(r"[^\w.+-]", "_", stem) or "encoder"
    number = 1
    while name in taken:
        number += 1
        name = f"{stem}_{number}"
    return name
