"""``train ckpt_path=RUN/checkpoints/last.ckpt`` alone: the command line of the run that is gone on with.

A training keeps its overrides in its checkpoints. A checkpoint may be a stranger's, so its overrides are read, not
obeyed: each has to choose a member of ``conf/`` by its name, or to set a plain value of a setting that says what is
computed. None can name a class, a folder to write to or a reference that would be resolved.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType, QuotedString
from hydra.errors import HydraException
from omegaconf import OmegaConf

from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.cli.encoder_file import EncoderFile, checked_encoder
from sci_lightning.cli.next_command import override as quoted
from sci_lightning.configuration.arguments import check_value
from sci_lightning.configuration.bounds import ExistingPath
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import excerpt, one_printable_line
from sci_lightning.runs.resume import another_training
from sci_lightning.runs.run_folder import is_first_process

GROUPS = {"encoder", "effect", "decoder", "data", "metric", "system", "trainer", "scale", "experiment"}
"""Groups of ``conf/`` whose members say what is computed; the others say where it is written and shown."""

SECTIONS = {"encoder", "effects", "decoder", "data", "benchmark", "metrics", "system"}
"""Sections of the configuration whose plain values are taken up."""

VALUES = ("frames", "size", "crop", "batch_size", "core_minutes", "seed")
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

PATHS = {"root", "val_root", "file"}
"""What settings that name files or folders to read are called."""

FINETUNE = "finetune"
"""The experiment that takes a decoder and starts a new training with it."""

LONGEST_OVERRIDES = 20_000
"""Characters of all overrides together."""

KEY = re.compile(r"[a-z][a-z0-9_]*(\.[a-zA-Z0-9][a-zA-Z0-9_]*)*", re.ASCII)
CHOICE = re.compile(r"[A-Za-z0-9][\w.+-]*", re.ASCII)


def continued(arguments: list[str], encoders: Iterable[str]) -> tuple[list[str], dict[str, EncoderFile]]:
    """Put the overrides of a run before those that are given to go on with it.

    Args:
        arguments: of the command line of ``train``.
        encoders: names of the members of the group ``encoder``.

    Returns:
        the arguments: as they are, unless they name a checkpoint with a training's progress (``ckpt_path=``, or
        ``out=RUN resume=true``); then what that run was started with, and ``out=RUN`` where that is not given. And the
        encoder of the run by its name, if it is not in ``conf/``. ``experiment=finetune`` starts a new run, which has
        the decoder, the data and the scale of the earlier one.

    Raises:
        BadInput: a checkpoint that cannot be read, overrides in it that a checkpoint may not hold, or files to read
            that lie neither in the current folder nor in the run's and that the arguments do not repeat.
    """
    given = {
        key.lstrip("+~"): value.strip("'\"") for key, _, value in (argument.partition("=") for argument in arguments)
    }
    path = _checkpoint(given)
    if path is None or {"-m", "--multirun"} & set(arguments):
        return arguments, {}
    check_value("ckpt_path", str(path), ExistingPath)
    from sci_lightning.runs.checkpoint import read_checkpoint  # torch is loaded when it is needed

    checkpoint = read_checkpoint(path)
    if not checkpoint.resumable:
        return arguments, {}
    config = checkpoint.config
    kept = overrides_of(path, config)
    if FINETUNE in _names(given.get("experiment", "")):
        return _finetuned(path, config, kept, arguments, given), {}
    if given.get("finetune", "").lower() == "true" and not config.get("finetune"):
        raise BadInput(
            f"{path}: give experiment={FINETUNE} in the place of finetune=true: it begins a training of its own, in a "
            "folder of its own"
        )
    was = {**{o.key_or_group: str(_bare(o.value())) for o in kept}, **config["names"]}
    for group in ("encoder", "decoder", "data", "system"):  # others would not even fit the settings of this one
        now = given.get(group, "")
        if kept and group in was and now not in ("", was[group]) and not now.endswith(".yaml"):
            raise BadInput(another_training(path, group, was[group], now))
    files: dict[str, EncoderFile] = {}
    before: list[str] = []
    named_paths: list[tuple[str, str]] = []
    for override in kept:
        key = override.key_or_group
        if key in given or (key == "encoder" and "encoder" in given):
            continue
        if key == "encoder" and str(_bare(override.value())) not in encoders:  # of a file, as it was then
            name = str(_bare(override.value()))
            files[name] = EncoderFile(path, checked_encoder(path, config["encoder"]))
            ConfigStore.instance().store(group="encoder", name=name, node=OmegaConf.create(files[name].content))
            named_paths += _paths("encoder", files[name].content)
        named_paths += _paths(key, override.value())
        before.append(str(override.input_line))
    _check_paths(path, [(key, value) for key, value in named_paths if key not in given])
    named = {override.key_or_group for override in kept} | given.keys()
    before += [
        f"{key}={str(config[key]).replace(' ', '')}"
        for key in VALUES
        if kept and key not in named and isinstance(config.get(key), (int, float, list))
    ]
    if kept and "warmup" not in config["system"] and "system.warmup" not in named:
        before.append("system.warmup=0")  # of an earlier version: its learning rates began at their full height
    folder = Path(os.path.abspath(path)).parent  # not resolved: what is named is written, wherever links lead
    if "out" not in given and path.name == "last.ckpt" and folder.name == "checkpoints":
        _check_folder(folder.parent)
        before.append(f"out='{folder.parent}'")
    return [*before, *arguments], files


def _finetuned(
    path: Path, config: Mapping[str, Any], kept: list[Override], arguments: list[str], given: Mapping[str, str]
) -> list[str]:
    """Return the arguments of a new training of the decoder that a checkpoint holds, behind another encoder.

    Decoder, data and scale are as they were in that training, the encoder is the one that is given, and the recipe sets
    what it sets: the plan and the learning rates of the training before are left out.
    """
    now = given.get("decoder", "")
    if now not in ("", was := str(config["names"]["decoder"])):
        raise BadInput(f"{path}: a decoder={was} cannot be fine-tuned as decoder={now}: leave decoder= out")
    if "encoder" not in given:
        raise BadInput(
            f"{path}: which camera shall the decoder get used to? Give encoder=FOUND/encoder.yaml, which a diagnosis "
            "writes, or the name of an encoder"
        )
    out = given.get("out")
    if out and given.get("resume", "").lower() != "true" and _last_of(out).is_file() and _last_of(out).samefile(path):
        raise BadInput(f"{out}: holds the training that is to be fine-tuned, which would be lost; give another out=")
    recipe = {*_keys(OmegaConf.to_container(OmegaConf.load(CONF / "experiment" / f"{FINETUNE}.yaml")))}
    before: list[str] = []
    named_paths: list[tuple[str, str]] = []
    experiments = _names(given["experiment"])
    for override in kept:
        key = override.key_or_group
        if key == "experiment":
            value = override.value()
            earlier = [str(_bare(name)) for name in (value if isinstance(value, list) else [value])]
            experiments = [name for name in earlier if name not in experiments] + experiments
        elif key not in given and key not in recipe and re.split(r"[./]", key)[0] not in ("encoder", "effect"):
            named_paths += _paths(key, override.value())
            before.append(str(override.input_line))
    _check_paths(path, named_paths)
    named = {override.key_or_group for override in kept} | given.keys()
    field = ("frames", "size") if given["encoder"].endswith(".yaml") else ()  # which the encoder file says
    for key in VALUES:
        whole = key == "crop" and config.get("crop") == config.get("size")
        if key not in {*named, *field, *recipe} and isinstance(config.get(key), (int, list)) and not whole:
            before.append(f"{key}={str(config[key]).replace(' ', '')}")
    before = [word for word in before if word.partition("=")[0] not in field]
    rest = [word for word in arguments if word.partition("=")[0].lstrip("+~") != "experiment"]
    return [f"experiment=[{','.join(experiments)}]", *before, *rest]


def _names(value: str) -> list[str]:
    """Return the names in the value of an override, one or a list in brackets."""
    return [name for part in value.strip("[]").split(",") if (name := part.strip(" '\""))]


def _keys(content: Any, above: str = "") -> Iterator[str]:
    """Yield the dotted keys of all values in a configuration."""
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _keys(value, f"{above}{key}.")
        else:
            yield f"{above}{key}"


def _check_folder(folder: Path) -> None:
    """Check that a run's folder can be gone on with although nobody said ``out=``: it may be a stranger's.

    Raises:
        BadInput: it has a link that leads out of it, over which other files would be written, or a name that would be
            obeyed.
    """
    if "${" in str(folder) or "'" in str(folder) or "\\" in str(folder):
        raise BadInput(f"{folder}: a name with ${{, ' or \\ would be obeyed, not read; rename the folder")
    real = folder.resolve()
    for place, folders, files in os.walk(real):
        for name in (*folders, *files):
            path = Path(place) / name
            if path.is_symlink() and not path.resolve().is_relative_to(real):
                raise BadInput(
                    f"{path}: a link that leads out of the run's folder, where other files would be overwritten; to "
                    f"go on there all the same, say so: out={folder}"
                )


def _paths(key: str, value: Any) -> Iterator[tuple[str, str]]:
    """Settings that name files to read, and what they name: by what they are called, and whatever looks like a path."""
    if isinstance(value, Mapping):
        for name, entry in value.items():
            yield from _paths(f"{key}.{_bare(name)}", entry)
    elif isinstance(value, list):
        for entry in value:
            yield from _paths(key, entry)
    elif isinstance(text := _bare(value), str) and (
        key.rpartition(".")[2] in PATHS or "/" in text or "\\" in text or text.startswith((".", "~"))
    ):
        yield key, text


def _check_paths(path: Path, named: list[tuple[str, str]]) -> None:
    """Check the files and folders that a checkpoint names, and show them: it may be a stranger's, and they are read.

    Raises:
        BadInput: one that lies neither in the current folder nor in that of the run. Links count as what they lead to.
    """
    if elsewhere := _elsewhere(path, named):
        raise BadInput(
            f"{path}: this training read files that lie neither in the current folder nor in the run's; if they are "
            f"yours, say so by repeating: {' '.join(map(one_printable_line, elsewhere))}"
        )
    if named and is_first_process():
        shown = ", ".join(f"{key}={excerpt(value)}" for key, value in named)
        PlainConsole().say("as recorded in ", styled(path), f": reads {shown}")


def _elsewhere(path: Path, named: Iterable[tuple[str, str]]) -> list[str]:
    """Those of the files that a checkpoint names which have to be repeated, as overrides."""
    own = [Path.cwd().resolve(), path.resolve().parent.parent]
    return [
        quoted(key, value)
        for key, value in dict(named).items()
        if not any(Path(os.path.expanduser(value)).resolve().is_relative_to(folder) for folder in own)
    ]


def repeated(path: Path, overrides: Iterable[str], encoder: Mapping[str, Any]) -> list[str]:
    """Return what has to stand beside ``ckpt_path=`` to go on with one's own run: files that lie elsewhere.

    Args:
        path: of the checkpoint.
        overrides: of the run.
        encoder: its configuration.
    """
    named = list(_paths("encoder", encoder))
    for line in recorded(overrides):
        override = _checked(path, line)
        named += _paths(override.key_or_group, override.value())
    return _elsewhere(path, named)


def recorded(overrides: Iterable[str]) -> list[str]:
    """Those of a run's overrides that a checkpoint keeps."""
    kept = []
    for line in overrides:
        try:
            kept.append(str(_checked("", line).input_line))
        except BadInput:  # where to write, what to show, references: not what is computed, or to be given again
            continue
    return kept


def overrides_of(path: Path, config: Mapping[str, Any]) -> list[Override]:
    """The overrides in a checkpoint's configuration, checked; none in one that was written before they were kept.

    Raises:
        BadInput: one that a checkpoint may not hold.
    """
    lines = config.get("overrides", [])
    if not isinstance(lines, list) or len(lines) > 1000 or not all(isinstance(line, str) for line in lines):
        raise BadInput(f"{path}: damaged: its overrides are not a list of texts")
    if sum(map(len, lines)) > LONGEST_OVERRIDES:  # Hydra takes minutes for a million
        raise BadInput(f"{path}: its overrides have more than {LONGEST_OVERRIDES:,} characters")
    return [_checked(path, line) for line in lines]


def _checkpoint(given: Mapping[str, str]) -> Path | None:
    """The checkpoint that a command line asks to go on with."""
    if (path := given.get("ckpt_path")) and path != "null":
        return Path(path)
    if given.get("resume", "").lower() == "true" and given.get("out"):
        last = _last_of(given["out"])
        return last if last.is_file() else None
    return None


def _last_of(out: str | Path) -> Path:
    """Return where a run keeps its last checkpoint."""
    return Path(out) / "checkpoints" / "last.ckpt"


def _checked(path: str | Path, line: str) -> Override:
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
    if key.partition("/")[0] in GROUPS and not rest:
        names = value if isinstance(value, list) else [value]
        right = all(CHOICE.fullmatch(part) for part in key.split("/")) and all(
            name is None or CHOICE.fullmatch(str(_bare(name))) for name in names
        )
    elif not KEY.fullmatch(key) or key in WRITTEN or not _is_plain(value):
        right = False
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
        return all(KEY.fullmatch(str(_bare(key))) for key in value) and all(map(_is_plain, value.values()))
    if isinstance(value, list):
        return all(map(_is_plain, value))
    return value is None or isinstance(_bare(value), (bool, int, float, str))


def _bare(value: Any) -> Any:
    return value.text if isinstance(value, QuotedString) else value
