"""``encoder=PATH/encoder.yaml``, ``decoder.camera=PATH/encoder.yaml``: an encoder that lies outside ``conf/``."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf

from sci_lightning.configuration.arguments import check_value
from sci_lightning.configuration.bounds import Frames, Size
from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import check_fields
from sci_lightning.files.plain_data import check_plain_data
from sci_lightning.files.plain_text import excerpt
from sci_lightning.files.stored_array import readable_shape
from sci_lightning.files.yaml_file import read_yaml

PLACES = {"encoder": "encoder", "decoder.camera": "encoder@camera"}
"""What the command line says, and what Hydra calls it."""

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


def adopt_encoder_files(arguments: list[str], taken: Iterable[str] = ()) -> tuple[list[str], dict[str, EncoderFile]]:
    """Make every encoder file that the arguments name a member of the group ``encoder``, at either of its places.

    The member lives in Hydra's store in memory, where multiruns and launchers find it, and is called after its file, or
    after the folder of a file called ``encoder.yaml``. Relative ``file:`` entries are taken from the file's own folder.

    Args:
        arguments: of the command line; ``encoder=a.yaml,b.yaml,lsw_sr`` is a sweep.
        taken: names that members have already.

    Returns:
        the arguments with names in the place of paths, as Hydra takes them, and the file behind each name.

    Raises:
        BadInput: a file that is missing, is no YAML, does not describe one object or holds more than plain data.
    """
    files: dict[str, EncoderFile] = {}

    def member(value: str) -> str:
        bare = value.strip().strip("'\"")
        if not bare.endswith(".yaml"):
            if "/" in bare:
                _refuse_path(Path(os.path.expanduser(bare)))
            return value
        file = read_encoder_file(Path(os.path.expanduser(bare)))
        name = _name(file.path.resolve(), {*taken, *files})
        files[name] = file
        ConfigStore.instance().store(group="encoder", name=name, node=OmegaConf.create(file.content))
        return f"'{name}'"

    adopted = []
    for argument in arguments:
        key, equals, value = argument.partition("=")
        bare = key.lstrip("+")
        if equals and bare in PLACES:
            place = key.replace(bare, PLACES[bare])
            argument = f"{place}={','.join(map(member, _members(value)))}"
        adopted.append(argument)
    return adopted, files


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


def read_encoder_file(path: Path) -> EncoderFile:
    """Read an encoder file and check that it holds plain data and the known references, before anything uses it.

    Raises:
        BadInput: see :func:`adopt_encoder_files`.
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


def adapt_to_encoder_files(cfg: DictConfig, files: Mapping[str, EncoderFile], overrides: Iterable[str]) -> None:
    """Fit a composed configuration to the encoder files in it.

    ``frames`` and ``size`` are the file's unless the command line says otherwise. Then every ``_target_`` is checked,
    and what was checked takes the place of the node, resolved: nothing is left in it that could still change.

    Args:
        cfg: of the command.
        files: by the place (a value of :data:`PLACES`) where each one stands.
        overrides: of the command line, as Hydra takes them.

    Raises:
        BadInput: files or settings that contradict each other, or a class that the file may not name.
    """
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
    for place, file in files.items():
        key = place.rpartition("@")[2]
        settings = OmegaConf.to_container(cfg[key], resolve=True)
        check_plain_data(file.path, settings)
        check_targets(file.path, settings, cfg.get("trusted") or [])
        check_fields(settings, f"{file.path}: ")
        cfg[key] = settings


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
