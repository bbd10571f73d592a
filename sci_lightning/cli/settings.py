"""The settings of commands, completed and checked.

What a class takes is checked against its signature (:mod:`sci_lightning.configuration.arguments`); what stands at the
top of ``conf/<command>.yaml`` against the class of settings beside the command in ``cli/commands``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, is_dataclass, replace
from importlib import import_module
from typing import Annotated, Any, Literal, get_type_hints

from annotated_types import DocInfo, Interval, Len, MinLen
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import StringConstraints

from sci_lightning.cli.composition import Composition
from sci_lightning.cli.encoder_file import adapt_to_encoder_files
from sci_lightning.cli.start import command_module
from sci_lightning.cli.stored_run import take_over
from sci_lightning.configuration.arguments import check_arguments, check_value
from sci_lightning.configuration.bounds import (
    Exists,
    Positive,
    Repeats,
    Size,
)
from sci_lightning.configuration.source_signature import check_parts
from sci_lightning.errors import BadInput
from sci_lightning.files.memory_bound import check_field

Name = Annotated[str, MinLen(1), DocInfo("a name")]
FolderName = Annotated[
    str,
    StringConstraints(pattern=r"^\w[\w.-]*$"),
    DocInfo("a name of letters, digits, '_', '-' and '.' (not the first)"),
]
Place = Annotated[str, MinLen(1), DocInfo("the path of a file or a folder")]
NamedOrPath = Annotated[str, MinLen(1), Exists(or_name=True), DocInfo("a name or the path of a file")]
Workers = Annotated[int, Interval(ge=0, le=1024)]
Count = Annotated[int, Interval(ge=0, le=10**9)]
Offset = Annotated[Sequence[Annotated[int, Interval(ge=-65536, le=65536)]], Len(2, 2)]

BitDepth = Annotated[int, Interval(ge=1, le=16)]
Aperture = Positive | str
Kernels = Literal["auto", "plain"]
Precision = Literal["auto", 32, "bf16", 16, "32-true", "bf16-mixed", "16-mixed"]


@dataclass(frozen=True)
class CommandSettings:
    """What a command takes: types and ranges. ``conf/COMMAND.yaml`` states the defaults and what they mean.

    The settings of a command are a subclass named after it, beside it in ``cli/commands``. These here all have.
    """

    out: Place
    debug: bool


@dataclass(frozen=True)
class StudySettings(CommandSettings):
    """What the commands take besides that run many independent cases, see :mod:`sci_lightning.studies.engine`."""

    workers: Workers
    threads: Repeats
    job: Count | None


def settings_of(command: str) -> dict[str, Any]:
    """Return types and ranges of a command's settings by key: of its class in ``cli/commands``, ``TrainSettings``.

    Args:
        command: the name of its file in ``conf/``.
    """
    name = "".join(word.capitalize() for word in command.split("_"))
    settings = getattr(import_module(command_module(command)), f"{name}Settings")
    return get_type_hints(settings, include_extras=True)


def complete(composition: Composition, command: str, row: bool = False) -> Composition:
    """Complete a composed configuration with what files say, and check it: the one check of every command.

    Args:
        composition: its ``cfg`` is changed: to encoder files in it, and to the training that it goes on with.
        command: the name of its file in ``conf/``.
        row: whether it is of a sweep, whose rows are composed in full.

    Returns:
        the composition, with the names that a stored training has for its parts.

    Raises:
        BadInput: files or settings that cannot be used, or that contradict each other.
    """
    cfg = composition.cfg
    adapt_to_encoder_files(cfg, composition.overrides, cfg.get("trusted") or ())
    if command == "train" and not row:
        composition = replace(composition, choices={**composition.choices, **take_over(composition)})
    check_command_settings(cfg, command)
    return composition


def check_command_settings(cfg: DictConfig, command: str) -> None:
    """Check the values at the top of a composed configuration, and the arguments of what its groups build.

    Args:
        cfg: of a command; settings that are still missing are left out.
        command: the name of its file in ``conf/``.

    Raises:
        BadInput: a value of another type or out of its range; a snapshot that no machine of this size could hold.
    """
    types = settings_of(command)
    settings = {key: _plain_value(cfg[key]) for key in types if key in cfg and not OmegaConf.is_missing(cfg, key)}
    for key, value in settings.items():
        annotation = types[key]
        if annotation in (Size, Size | None) and isinstance(value, int):
            raise BadInput(f"{key}={value}: expected [height,width]; of a square '{key}=[{value},{value}]'")
        if is_dataclass(annotation) and isinstance(annotation, type):
            check_value(key, value, Mapping[str, Any])
            check_arguments(annotation, value, key)
        else:
            check_value(key, value, annotation)
    check_field(settings.get("frames"), settings.get("size"))
    for group in map(str, cfg):
        if group not in types and OmegaConf.is_config(node := cfg.get(group)):
            with suppress(OmegaConfBaseException):  # a reference to what is still missing; refused where it is built
                check_parts(OmegaConf.to_container(node, resolve=True), group)


def _plain_value(value: Any) -> Any:
    return OmegaConf.to_container(value) if OmegaConf.is_config(value) else value
