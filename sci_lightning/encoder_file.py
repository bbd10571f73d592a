"""``encoder=PATH/encoder.yaml``, ``decoder.camera=PATH/encoder.yaml``: an encoder that lies outside ``conf/``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, ListConfig, OmegaConf

from sci_lightning.errors import BadInput

PLACES = {"encoder": "encoder", "decoder.camera": "encoder@camera"}
"""What the command line says, and what Hydra calls it."""


def adopt_encoder_files(arguments: list[str], taken: Iterable[str] = ()) -> tuple[list[str], dict[str, Path]]:
    """Make every encoder file that the arguments name a member of the group ``encoder``, at either of its places.

    The member lives in Hydra's store in memory, where multiruns and launchers find it, and is called after its file, or
    after the folder of a file called ``encoder.yaml``. Relative ``file:`` entries are taken from the file's own folder.

    Args:
        arguments: of the command line; ``encoder=a.yaml,b.yaml,lsw_sr`` is a sweep.
        taken: names that members have already.

    Returns:
        the arguments with names in the place of paths, as Hydra takes them, and the path of each name.

    Raises:
        BadInput: a file that is missing, is no YAML or does not describe one object.
    """
    names: dict[str, Path] = {}

    def member(value: str) -> str:
        bare = value.strip().strip("'\"")
        if not bare.endswith(".yaml"):
            return value
        path = Path(bare).expanduser()
        config = _read(path)
        name = _name(path.resolve(), {*taken, *names})
        names[name] = path
        ConfigStore.instance().store(group="encoder", name=name, node=config)
        return f"'{name}'"

    adopted = []
    for argument in arguments:
        key, equals, value = argument.partition("=")
        bare = key.lstrip("+")
        if equals and bare in PLACES:
            place = key.replace(bare, PLACES[bare])
            argument = f"{place}={','.join(member(each) for each in value.split(','))}"
        adopted.append(argument)
    return adopted, names


def _read(path: Path) -> DictConfig:
    if not path.is_file():
        raise BadInput(f"{path}: no such encoder file; give the encoder.yaml of a diagnosis, or a name such as lsw_sr")
    try:
        config = OmegaConf.load(path)
    except Exception as error:  # YAML's and OmegaConf's errors, and those of decoding
        reason = " ".join(str(error).split())
        raise BadInput(f"{path}: not a readable YAML file ({reason})") from error
    if not isinstance(config, DictConfig) or "_target_" not in config:
        raise BadInput(f"{path}: not an encoder; expected a mapping with _target_: sci_lightning.encoder.Encoder")
    _anchor(config, path.resolve().parent)
    return config


def _anchor(config: Any, folder: Path) -> None:
    """Take relative ``file:`` entries from ``folder``."""
    if isinstance(config, ListConfig):
        for value in config._iter_ex(resolve=False):
            _anchor(value, folder)
    elif isinstance(config, DictConfig):
        for key, value in config.items_ex(resolve=False):
            if key == "file" and isinstance(value, str) and "${" not in value and value != "???":
                config[key] = str(folder / Path(value).expanduser())
            else:
                _anchor(value, folder)


def _name(path: Path, taken: set[str]) -> str:
    stem = path.parent.name if path.stem == "encoder" else path.stem
    name = stem = re.sub(r"[^\w.+-]", "_", stem) or "encoder"
    number = 1
    while name in taken:
        number += 1
        name = f"{stem}_{number}"
    return name
