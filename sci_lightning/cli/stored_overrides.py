"""Overrides of a command line in a checkpoint, which may be a stranger's: they are read, not obeyed.

Each has to choose a member of ``conf/`` by its name, or to set a plain value of a setting that says what is computed or
shown. None can name a class, a folder to write to, a server or a reference that would be resolved.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType, QuotedString
from hydra.errors import HydraException

from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt

GROUPS = {"encoder", "effect", "decoder", "data", "metric", "system", "trainer", "scale", "experiment"}
"""Groups of ``conf/`` whose members say what is computed."""

LOGGERS = {"tensorboard", "csv", "none"}
"""Members of the group ``logger`` that write into the run's folder; others send what they log to somebody."""

SECTIONS = {"encoder", "effects", "decoder", "data", "benchmark", "metrics", "system"}
"""Sections of the configuration whose plain values are taken up."""

SHOWN = {"callbacks", "logger"}
"""Sections that say what is shown and logged: numbers are taken up, and texts that are names."""

NAMES = {"name", "version", "run_name", "experiment_name", "project", "prefix", "monitor", "metric"}
"""Settings of those sections that may be texts."""

PLACES = re.compile(r"dir|folder|path|file|uri|url|host", re.ASCII)
"""What settings of those sections that say where something is written have in their names."""

VALUES = (
    *("frames", "size", "crop", "batch_size", "core_minutes", "seed", "precision", "initialisation", "kernels"),
    *("mask_tile", "mask_bits", "mask_sharpness", "mask_start"),
)
"""Settings of the run itself."""

TRAINER = {
    "accelerator",
    "accumulate_grad_batches",
    "check_val_every_n_epoch",
    "deterministic",
    "devices",
    "gradient_clip_algorithm",
    "gradient_clip_val",
    "limit_test_batches",
    "limit_train_batches",
    "limit_val_batches",
    "log_every_n_steps",
    "max_epochs",
    "max_steps",
    "max_time",
    "num_nodes",
    "num_sanity_val_steps",
    "precision",
    "strategy",
    "val_check_interval",
}
"""Settings of the trainer that are taken up: none of its paths and objects."""

WRITTEN = {"data.store"}
"""Folders that data sources write to."""

LONGEST_OVERRIDES = 20_000
"""Characters of all overrides together."""

KEY = re.compile(r"[a-z][a-z0-9_]*(\.[a-zA-Z0-9][a-zA-Z0-9_]*)*", re.ASCII)
CHOICE = re.compile(r"[A-Za-z0-9][\w.+-]*", re.ASCII)


def recorded(overrides: Iterable[str]) -> list[str]:
    """Return those of a run's overrides that a checkpoint keeps."""
    return [line for line in overrides if is_kept(line)]


def is_kept(line: str) -> bool:
    """Return whether a checkpoint keeps an override: none that says where to write, or that names a class."""
    try:
        checked("", line)
    except BadInput:
        return False
    return True


def overrides_of(path: Path, config: Mapping[str, Any]) -> list[Override]:
    """Return the overrides in a checkpoint's configuration, checked; none in one of an earlier version.

    Raises:
        BadInput: one that a checkpoint may not hold.
    """
    lines = config.get("overrides", [])
    if not isinstance(lines, list) or len(lines) > 1000 or not all(isinstance(line, str) for line in lines):
        raise BadInput(f"{path}: damaged: its overrides are not a list of texts")
    if sum(map(len, lines)) > LONGEST_OVERRIDES:  # Hydra takes minutes for a million
        raise BadInput(f"{path}: its overrides have more than {LONGEST_OVERRIDES:,} characters")
    return [checked(path, line) for line in lines]


def checked(path: str | Path, line: str) -> Override:
    """Return one override of a checkpoint; raises as :func:`overrides_of` does."""
    refused = BadInput(
        f"{path}: its override '{excerpt(line)}' is not one that a checkpoint may hold; give the overrides of the run "
        "yourself, and start anew from its weights (convert)"
    )
    try:
        override = OverridesParser.create().parse_override(line)
        value = override.value()
    except (HydraException, RecursionError, ValueError) as error:
        raise refused from error
    key = override.key_or_group
    plain = override.type in (OverrideType.CHANGE, OverrideType.ADD, OverrideType.FORCE_ADD)
    if not plain or override.is_sweep_override() or override.package is not None or "\n" in line or "${" in line:
        raise refused
    root, _, rest = key.partition(".")
    names = [bare(name) for name in (value if isinstance(value, list) else [value])]
    if key.partition("/")[0] in GROUPS and not rest:
        right = all(CHOICE.fullmatch(part) for part in key.split("/")) and all(
            name is None or CHOICE.fullmatch(str(name)) for name in names
        )
    elif key == "logger":
        right = LOGGERS.issuperset(names)
    elif not KEY.fullmatch(key) or key in WRITTEN or not _is_plain(value):
        right = False
    elif root in SHOWN:
        last = key.rpartition(".")[2]
        texts = last in NAMES and isinstance(names[0], str) and CHOICE.fullmatch(names[0]) is not None
        right = bool(rest) and not PLACES.search(last) and len(names) == 1
        right = right and (texts or names[0] is None or isinstance(names[0], (bool, int, float)))
    elif key == "trainer.devices" and isinstance(value, int):
        right = value <= (os.cpu_count() or 1)  # every one is a process
    elif root == "trainer":
        right = rest.partition(".")[0] in TRAINER
    else:
        right = key in VALUES or (root in SECTIONS and bool(rest))
    if not right:
        raise refused
    return override


def _is_plain(value: Any) -> bool:
    """Whether an override's value is made of numbers, texts, lists and mappings that name no class."""
    if isinstance(value, dict):
        return all(KEY.fullmatch(str(bare(key))) for key in value) and all(map(_is_plain, value.values()))
    if isinstance(value, list):
        return all(map(_is_plain, value))
    return value is None or isinstance(bare(value), (bool, int, float, str))


def bare(value: Any) -> Any:
    """Return an override's value, a text in quotes without them."""
    return value.text if isinstance(value, QuotedString) else value
