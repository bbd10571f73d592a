"""The commands' own settings: type and range of every key that is not a group of choices.

What a class takes is checked against its signature (:mod:`sci_lightning.configuration.arguments`); what stands at the
top of ``conf/<command>.yaml`` is checked here. One key means the same in every command.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import is_dataclass, replace
from typing import Annotated, Any, Literal

from annotated_types import DocInfo, Interval, Len, MinLen
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import StringConstraints

from sci_lightning.cli.composition import Composition
from sci_lightning.cli.encoder_file import adapt_to_encoder_files
from sci_lightning.cli.stored_run import take_over
from sci_lightning.configuration.arguments import check_arguments, check_value
from sci_lightning.configuration.bounds import (
    Bits,
    Depth,
    ExistingPath,
    Exists,
    Frames,
    NonNegative,
    Pixels,
    Positive,
    Repeats,
    Seed,
    Share,
    Size,
    Step,
    Width,
)
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.configuration.source_signature import check_parts
from sci_lightning.diagnosis.search_settings import SearchSettings
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

SETTINGS: Mapping[str, Any] = {
    # several commands
    "out": Place,
    "debug": bool,
    "seed": Seed,
    "frames": Frames,
    "size": Size | Annotated[int, Interval(ge=1, le=65536)],
    "crop": Size,
    "ckpt_path": ExistingPath,
    "trusted": Sequence[Name],
    "captures": ExistingPath,
    "device": Name,
    "workers": Workers,
    "initialisation": Literal["layers", "unit_variance"],
    "kernels": Literal["auto", "plain"],
    "precision": Literal["auto", 32, "bf16", 16, "32-true", "bf16-mixed", "16-mixed"],
    # train
    "batch_size": Repeats,
    "resume": bool,
    "dry_run": bool,
    "core_minutes": Positive,
    "mask_tile": Size,
    "mask_bits": Bits,
    "mask_sharpness": Positive,
    "mask_start": Literal["published", "designed"],
    "scale": Name,
    "test_encoders": Mapping[str, Any],
    "finetune": bool,
    # evaluate and reconstruct: how a field is cut; design_mask: what repeats. Both check it where they use it.
    "tile": Any,
    # evaluate
    "pictures": Count,
    # reconstruct
    "measurement": ExistingPath,
    "key": Name,
    "mask": NamedOrPath,
    "mask_dark": NonNegative,
    "mask_white": Positive,
    "raw_format": Name,
    "raw_size": Size,
    "full_scale": Positive,
    "aperture": Positive | str,
    "fps": Annotated[float, Interval(ge=0.1, le=50)],  # of a GIF: browsers slow faster ones down
    # design_mask
    "kind": Literal["structural", "binary"],
    "density": Share,
    "steps": Repeats,
    "read_noise": NonNegative,
    "full_well": Positive,
    "prior": NamedOrPath,
    # tables.mask_ranking
    "root": ExistingPath,
    "val_root": ExistingPath,
    "side": Pixels,
    "channels": Width,
    "blocks": Depth,
    "first_estimate": Literal["published", "linear"],
    "seconds": Positive,
    # convert
    "checkpoint": ExistingPath,
    # tables
    "runs": ExistingPath | Sequence[ExistingPath],
    "documentation": Place,
    "dashboard": bool,
    "mosaic": Count,
    # tables.rows
    "overrides": Annotated[str, DocInfo("overrides of every training, as one text")],
    "row_scale": Name,
    "label": FolderName,
    "results": Place,
    "sensor": Mapping[str, Positive | None],
    # export_mask
    "repeat": Repeats,
    "canvas": Size,
    "frame_rate": Positive,
    "binary_rate": Positive,
    "gray_rate": Positive,
    # benchmark
    "only": Sequence[Name],
    "reduced": Name,
    "training": Annotated[int, Interval(ge=0, le=65536)],
    "compile": bool,
    "warm_up": Count,
    "repeats": Repeats,
    "budget": NonNegative,
    "product": Annotated[int, Interval(ge=0, le=65536)],
    # diagnose
    "mask_key": Name,
    "mask_step": Step,
    "mask_origin": Offset,
    "mask_slots": Frames,
    "verification": Sequence[Count],
    "search": SearchSettings,
    "free_forms": bool,
    "leave_out": Sequence[Name],
    "candidates": Annotated[Mapping[str, Name], DocInfo("effects of your own, +candidates.mine=my_module.Mine")],
    # captures, virtual_camera.reveal (the number of captures of a kind: see virtual_camera)
    "folder": ExistingPath,
    "perspective": bool,
    "pitch": Annotated[Sequence[Positive], Len(2, 2), DocInfo("two positive numbers [ACROSS,DOWN]")],
    "again": bool,
    "truth": ExistingPath,
    "report": ExistingPath,
    "long_dark": Count,
    "long_exposure": Positive,
    "target": Count,
    "field": Size,
    # virtual_camera
    "effects": Any,
    "number": Count,
    "magnitude": Name,
    "bit_depth": Annotated[int, Interval(ge=1, le=16)],
    "bits": Annotated[int, Interval(ge=1, le=8)],
    "dark": Count,
    "flat": Count,
    "all_on": Count,
    "all_off": Count,
    "pattern": Count,
    "static": Count,
    "dynamic": Count,
    "unknown": Count,
    "dark_exposures": Sequence[Positive],
    "full_well_e": Positive,
    "read_noise_dn": NonNegative,
    "datasheet": bool,
    "datasheet_factor": Positive,
    "formulation": Name,
    "oversampling": Repeats,
    "surround": Name,
    # proving_ground
    "suites": Sequence[Name],
    "seeds": Repeats,
    "other_seeds": Repeats,
    "cases": Repeats | None,  # 4 where nothing is said; null for all
    "masks": Sequence[Name],
    "slots": Sequence[Frames],
    "datasheets": Sequence[Name],
    "formulations": Sequence[Name],
    "bit_depths": Sequence[Annotated[int, Interval(ge=1, le=16)]],
    "threads": Repeats,
    "run": bool,
    # mismatch, which checks cameras and ranges itself
    "decoders": Annotated[Sequence[Name], MinLen(1)],
    "weights": Mapping[str, Place],
    "cameras": Sequence[Name],
    "scenarios": Sequence[Literal["ideal", "ideal_noisy", "mismatched", "known", "calibrated", "blind"]],
    "drawn": Count,
    "mismatch": Annotated[Mapping[str, Any], DocInfo("effects with their parameters, mismatch.gain.factor=1.05")],
    "ranges": Annotated[Mapping[str, Any], DocInfo("effects with ranges, 'ranges.gain.factor=[0.5,1.5]'")],
    "calibration": Annotated[Mapping[str, Any], DocInfo("numbers of captures by kind, calibration.dark=4")],
    "middle": Size,
    "snapshots": Repeats,
    # mismatch.finetuning
    "protocol": Annotated[str, DocInfo("overrides of the protocol, as one text")],
    "recipe": Annotated[str, DocInfo("overrides of every fine-tuning, as one text")],
}


def check_settings(settings: Mapping[str, Any], nullable: Iterable[str]) -> None:
    """Check a command's own settings.

    Args:
        settings: resolved values by key; keys that are not in :data:`SETTINGS` are groups and checked elsewhere.
        nullable: keys that may be None, because that is what the command's file says where the user says nothing.

    Raises:
        BadInput: a value of another type or out of its range; a snapshot that no machine of this size could hold.
    """
    free = set(nullable)
    for key, value in settings.items():
        if key in SETTINGS and is_dataclass(SETTINGS[key]):
            check_value(key, value, Mapping[str, Any])
            check_arguments(SETTINGS[key], value, key)
        elif key in SETTINGS:
            check_value(key, value, SETTINGS[key] | None if key in free and SETTINGS[key] is not Any else SETTINGS[key])
    check_field(settings.get("frames"), settings.get("size"))


def settle(composition: Composition, command: str, row: bool = False) -> Composition:
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
    """Check the values at the top of a composed configuration that are no groups.

    Args:
        cfg: of a command; settings that are still missing are left out.
        command: the name of its file in ``conf/``. A setting that is null there may be null.

    Raises:
        BadInput: see :func:`check_settings`.
    """
    present = [str(key) for key in cfg if key in SETTINGS and not OmegaConf.is_missing(cfg, key)]
    settings = {key: _plain_value(cfg[key]) for key in present}
    defaults = OmegaConf.load(CONF / f"{command}.yaml")
    if not isinstance(defaults, DictConfig):
        raise TypeError(f"conf/{command}.yaml: expected a mapping")
    for key in ("size", "crop"):
        if isinstance(side := settings.get(key), int) and not isinstance(defaults.get(key), int):
            raise BadInput(f"{key}={side}: expected [height,width]; of a square '{key}=[{side},{side}]'")
    nullable = [str(key) for key, value in defaults.items_ex(resolve=False) if value is None]
    check_settings(settings, nullable)
    for group in map(str, cfg):
        if group not in SETTINGS and OmegaConf.is_config(node := cfg.get(group)):
            with suppress(OmegaConfBaseException):  # a reference to what is still missing; refused where it is built
                check_parts(OmegaConf.to_container(node, resolve=True), group)


def _plain_value(value: Any) -> Any:
    return OmegaConf.to_container(value) if OmegaConf.is_config(value) else value
