"""``train ckpt_path=RUN/checkpoints/last.ckpt`` alone: a training goes on as it was configured.

A checkpoint holds the plain configuration of its run. It takes the place of what is composed, but for what the command
line says itself. The checkpoint may be a stranger's: its values are checked and compared, and none of them names a
class that is not ours or trusted, a folder to write to, a server, or a file of the reader's that lies elsewhere.
"""

from __future__ import annotations

import os
from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, QuotedString
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf, open_dict

from sci_lightning.cli.composition import Composition, compose, group_members, targets_in
from sci_lightning.cli.named_files import check_links, check_paths, elsewhere, named_files
from sci_lightning.cli.next_command import nearest
from sci_lightning.cli.next_command import override as quoted
from sci_lightning.configuration.arguments import check_value
from sci_lightning.configuration.bounds import ExistingPath
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_data import check_plain_data
from sci_lightning.plain_text import excerpt
from sci_lightning.runs.encoder_file import checked_encoder
from sci_lightning.runs.resume import another_training

if TYPE_CHECKING:
    from sci_lightning.runs.checkpoint import Checkpoint

CHOICES = ("encoder", "decoder", "data", "data@benchmark", "system")
"""Groups whose chosen members a checkpoint names, under ``names``."""

SECTIONS = {
    "encoder": "encoder",
    "test_encoders": "encoder",
    "decoder": "decoder",
    "data": "data",
    "benchmark": "data",
    "metrics": "metric",
    "system": "system",
}
"""Sections of a configuration that a checkpoint settles, and the groups whose classes they may name."""

VALUES = (
    *("frames", "size", "crop", "batch_size", "core_minutes", "seed", "scale", "precision"),
    *("initialisation", "kernels", "mask_tile", "mask_bits", "mask_sharpness", "mask_start"),
)
"""Plain settings that a checkpoint settles."""

TRAINER = (
    *("accelerator", "accumulate_grad_batches", "check_val_every_n_epoch", "deterministic", "devices"),
    *("gradient_clip_algorithm", "gradient_clip_val", "limit_test_batches", "limit_train_batches"),
    *("limit_val_batches", "log_every_n_steps", "max_epochs", "max_steps", "max_time", "num_nodes"),
    *("num_sanity_val_steps", "precision", "strategy", "val_check_interval"),
)
"""Settings of the trainer that a checkpoint settles: none of its paths and objects."""

LOGGERS = {"tensorboard", "csv"}
"""Loggers that write into the run's folder; others send what they log to somebody, and have to be named again."""

SHOWN = ("callbacks", "logger")
"""Sections that say what is shown and logged. Of these a checkpoint settles numbers and what is left out."""

WRITTEN = ("data.store", "benchmark.store")
"""Folders that data sources write to."""

FINETUNE = "finetune"
"""The experiment that takes a decoder and starts a new training with it."""

NOT_AGAIN = {"ckpt_path", "resume", "dry_run", "debug", "out", "trusted", "hydra.searchpath"}
"""Settings of one command line that are not those of the run, or that :func:`to_repeat` writes itself."""

ABSENT = object()


def with_stored_choices(arguments: Sequence[str]) -> list[str]:
    """Put what a run chose before the words of the command line that goes on with it.

    Hydra composes a configuration of these choices, which :func:`take_over` fills with the values of the checkpoint.

    Args:
        arguments: of the command line of ``train``.

    Returns:
        the arguments: as they are, unless they name a checkpoint with a training's progress (``ckpt_path=``, or
        ``out=RUN resume=true``); then what that run chose of each group, and ``out=RUN`` where that is not given.

    Raises:
        BadInput: a checkpoint that cannot be read, or a folder whose links lead out of it.
    """
    given = {override.key_or_group: override for override in _parsed(arguments)}
    values = {key: _bare(override.value()) for key, override in given.items() if not override.is_sweep_override()}
    checkpoint = _stored(values)
    if checkpoint is None or {"-m", "--multirun"} & set(arguments):
        return list(arguments)
    path = Path(checkpoint.path)
    names, finetuned = checkpoint.config["names"], _is_finetuning(values)
    if finetuned:
        _check_finetuning(path, names, values)
    words = [
        f"{group}={names[group]}" for group in CHOICES if group not in given and _is_member(group, names.get(group))
    ]
    loggers = checkpoint.config.get("logger") or {}
    if not finetuned and "logger" not in given and isinstance(loggers, Mapping) and LOGGERS.issuperset(loggers):
        words.append(f"logger=[{','.join(loggers)}]")
    folder = Path(os.path.abspath(path)).parent  # not resolved: what is named is written, wherever links lead
    if not finetuned and "out" not in given and path.name == "last.ckpt" and folder.name == "checkpoints":
        check_links(folder.parent)
        words.append(f"out='{folder.parent}'")
    return [*words, *arguments]


def take_over(composition: Composition) -> dict[str, str]:
    """Fill the composed configuration of ``train`` with that of the training which it goes on with.

    Args:
        composition: with the choices of :func:`with_stored_choices`; its ``cfg`` is changed.

    Returns:
        names of what the checkpoint itself configures, by group; nothing without a checkpoint that can be gone on with.

    Raises:
        BadInput: another training than that of the checkpoint, values that a checkpoint may not hold, or files to read
            that lie neither in the current folder nor in the run's.
    """
    cfg, choices = composition.cfg, composition.choices
    checkpoint = _stored({key: cfg.get(key) for key in ("ckpt_path", "resume", "out")})
    if checkpoint is None:
        return {}
    path, config = Path(checkpoint.path), checkpoint.config
    names = config["names"]
    given = {override.key_or_group: _bare(override.value()) for override in _parsed(composition.overrides)}
    finetuned = cfg.finetune and _is_finetuning(given)
    if cfg.finetune and not finetuned and not config.get("finetune"):
        raise BadInput(
            f"{path}: give experiment={FINETUNE} in the place of finetune=true: it begins a training of its own, in a "
            "folder of its own"
        )
    of_file = "encoder" in given and choices["encoder"] not in group_members("encoder")
    for group in ("encoder", "decoder", "data", "system"):  # others would not even fit the settings
        other = group in given and choices[group] != names.get(group, choices[group])
        if other and not finetuned and not (group == "encoder" and of_file):
            raise BadInput(another_training(path, group, names[group], choices[group]))

    members = [f"{group}={choices[group]}" for group in CHOICES if _is_member(group, choices[group])]
    said_encoder = finetuned or of_file
    stored = _admitted(path, config, composition, without="encoder" if said_encoder else "")
    if finetuned and of_file:  # the file says how large the field is
        if stored.pop("crop") != stored.pop("size"):
            cfg.crop = config["crop"]
        stored.pop("frames")
    before, now = _plain(compose("train", members).cfg), _plain(cfg)
    merged = {key: _merged(value, before.get(key, ABSENT), now.get(key, ABSENT)) for key, value in stored.items()}
    settled = OmegaConf.create(merged)
    if finetuned:
        settled.merge_with(OmegaConf.load(CONF / "experiment" / f"{FINETUNE}.yaml"))
    for key in (*(key for key in given if not _is_group(key)), *WRITTEN):  # what the command line itself says
        if key.partition(".")[0] in settled and OmegaConf.select(cfg, key, default=ABSENT) is not ABSENT:
            OmegaConf.update(settled, key, OmegaConf.select(cfg, key), merge=False)
    taken = _plain(settled)
    check_paths(path, set(named_files("", taken)) - set(named_files("", now)))
    trainer = taken.pop("trainer")
    cfg.trainer.update({key: trainer[key] for key in TRAINER if key in trainer})
    if not finetuned:
        cfg.finetune = config.get("finetune") is True
        for key in SHOWN:
            _take_numbers(cfg.get(key) or {}, config.get(key) or {}, key, given)
    with open_dict(cfg):
        for key, value in taken.items():
            cfg[key] = value
    return {key: names[key] for key in ("encoder", "decoder") if not (said_encoder and key == "encoder")}


def to_repeat(path: Path, composition: Composition) -> list[str]:
    """Return what has to stand beside ``ckpt_path=`` to go on with one's own run: what its checkpoint may not ask for.

    Args:
        path: of the checkpoint.
        composition: of the run.
    """
    words, repeated = [], set[str]()  # a group that is chosen again has the defaults again, so that its settings follow
    for override in sorted(_parsed(composition.overrides), key=lambda one: not _is_group(one.key_or_group)):
        key, value = override.key_or_group, override.value()
        root, _, rest = key.partition(".")
        if _is_group(key):
            names = {str(_bare(name)) for name in (value if isinstance(value, list) else [value])}
            known = LOGGERS | {"none"} if key == "logger" else set(group_members(key.partition("@")[0]))
            settled = key.partition("/")[0] in ("encoder", "effect", "experiment", "scale") or names <= known
        elif root in SHOWN:
            settled = bool(rest) and (value is None or isinstance(value, (bool, int, float)))
        else:
            settled = root in (*SECTIONS, *VALUES) and key not in WRITTEN and root not in repeated
            settled = settled or (root == "trainer" and rest in TRAINER)
        if not settled and key not in NOT_AGAIN:
            words.append(str(override.input_line))
            if _is_group(key):
                repeated.add(key.partition("@")[2] or key)
    folder = Path(composition.cfg.out).absolute()
    out = [] if path.absolute() == _last_of(folder) else [quoted("out", nearest(folder))]
    files = elsewhere(path, named_files("", {key: _plain(composition.cfg).get(key) for key in SECTIONS}))
    return [*composition.own_folders(), *composition.trusted(), *files, *words, *out]


def _parsed(arguments: Iterable[str]) -> list[Override]:
    """Return the overrides among words of a command line; what Hydra cannot read is refused by Hydra itself."""
    parser, overrides = OverridesParser.create(), []
    for word in arguments:
        try:
            overrides += [] if word.startswith("-") else [parser.parse_override(word)]
        except HydraException:
            continue
    return overrides


def _bare(value: Any) -> Any:
    """Return an override's value, a text in quotes without them."""
    return value.text if isinstance(value, QuotedString) else value


def _is_member(group: str, name: str | None) -> bool:
    """Return whether a name is that of a member of a group that comes with the package."""
    return name in group_members(group.partition("@")[0])


def _is_group(key: str) -> bool:
    return "." not in key and (key.startswith("hydra/") or (CONF / key.partition("@")[0]).is_dir())


def _is_finetuning(values: Mapping[str, Any]) -> bool:
    experiments = values.get("experiment")
    return FINETUNE in [_bare(name) for name in (experiments if isinstance(experiments, list) else [experiments])]


def _check_finetuning(path: Path, names: Mapping[str, str], given: Mapping[str, Any]) -> None:
    """Check what begins a new training of the decoder in a checkpoint, behind another encoder.

    Decoder, data and sizes are as they were in that training, the encoder is the one that is given, and the recipe sets
    what it sets.
    """
    if (now := given.get("decoder", names["decoder"])) != names["decoder"]:
        raise BadInput(
            f"{path}: a decoder={names['decoder']} cannot be fine-tuned as decoder={now}: leave decoder= out"
        )
    if "encoder" not in given:
        raise BadInput(
            f"{path}: which camera shall the decoder get used to? Give encoder=FOUND/encoder.yaml, which a diagnosis "
            "writes, or the name of an encoder"
        )
    out = given.get("out")
    if out and given.get("resume") is not True and _last_of(out).is_file() and _last_of(out).samefile(path):
        raise BadInput(f"{out}: holds the training that is to be fine-tuned, which would be lost; give another out=")


def _admitted(path: Path, config: Mapping[str, Any], composition: Composition, without: str) -> dict[str, Any]:
    """Return what a checkpoint settles of a configuration: plain values, and sections but those of one group.

    Raises:
        BadInput: values that are not plain, or classes that a checkpoint may not name.
    """
    from sci_lightning.configuration.registry import check_targets

    trainer = config.get("trainer") or {}
    sections = [key for key, group in SECTIONS.items() if group != without]
    stored = {key: config[key] for key in (*sections, *VALUES) if key in config}
    stored["trainer"] = {key: trainer[key] for key in TRAINER if key in trainer}
    check_plain_data(path, stored)
    devices = stored["trainer"].get("devices")
    if isinstance(devices, int) and devices > (os.cpu_count() or 1):  # every one is a process
        raise BadInput(f"{path}: trainer.devices={devices}, more than this machine has; give trainer.devices=1")
    for key in (*sections, "trainer", *SHOWN):
        if not isinstance(config.get(key, {}), Mapping):
            raise BadInput(f"{path}: its {key} is {excerpt(repr(config[key]))}, expected a mapping")
    if words := _words_of_hydra(stored):
        raise BadInput(f"{path}: holds '{excerpt(min(words))}', which says how to build something; a file may not")
    now = _plain(composition.cfg)
    for key in sections:
        if SECTIONS[key] in ("encoder", "decoder"):
            check_targets(path, stored.get(key), tuple(composition.cfg.get("trusted") or ()))
        elif other := {*targets_in(stored.get(key))} - {*targets_in(now.get(key)), *composition.targets(SECTIONS[key])}:
            raise BadInput(
                f"{path}: its training used {excerpt(min(other))}, no {SECTIONS[key]} of the package: say again "
                f"where it is named, 'hydra.searchpath=[FOLDER]' {SECTIONS[key]}=.."
            )
    for section in {key.partition(".")[0] for key in WRITTEN} & stored.keys():
        stored[section] = {key: value for key, value in stored[section].items() if f"{section}.{key}" not in WRITTEN}
    if "encoder" in stored:
        stored["encoder"] = checked_encoder(path, stored["encoder"])
    return stored


def _words_of_hydra(content: Any) -> set[str]:
    """Return the keys in plain data that Hydra would obey: all that begin with a line, but for ``_target_``."""
    if isinstance(content, Mapping):
        return {str(key) for key in content if str(key).startswith("_") and key != "_target_"}.union(
            *map(_words_of_hydra, content.values())
        )
    return set().union(*map(_words_of_hydra, content)) if isinstance(content, (list, tuple)) else set()


def _plain(cfg: DictConfig) -> dict[str, Any]:
    """Return a configuration without Hydra's part as plain data, in which values may be missing."""
    own = OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key != "hydra"])
    return cast("dict[str, Any]", OmegaConf.to_container(own, resolve=True))


def _merged(stored: Any, before: Any, now: Any) -> Any:
    """Return stored values with what the command line changes: ``before`` is without its words, ``now`` with them."""
    if now == before:
        return stored
    parts = (stored, before, now)
    if all(isinstance(part, Mapping) for part in parts) and before.get("_target_") == now.get("_target_"):
        merged = {key: _merged(*(part.get(key, ABSENT) for part in parts)) for key in {**stored, **now}}
        return {key: value for key, value in merged.items() if value is not ABSENT}
    return now


def _take_numbers(node: Any, stored: Any, place: str, given: Container[str]) -> None:
    """Take what is no text of a section: a stranger's texts might say where something is written, or what is built."""
    for key, value in stored.items() if isinstance(stored, Mapping) else ():
        if key in node and f"{place}.{key}" not in given:
            if isinstance(value, Mapping) and OmegaConf.is_config(node[key]):
                _take_numbers(node[key], value, f"{place}.{key}", given)
            elif value is None or isinstance(value, (bool, int, float)):
                node[key] = value


def _stored(values: Mapping[str, Any]) -> Checkpoint | None:
    """Return the checkpoint that settings ask to go on with, if it holds a training's progress."""
    path = values.get("ckpt_path")
    if path is None and values.get("resume") is True and values.get("out") is not None:
        path = _last_of(str(values["out"]))
        path = path if path.is_file() else None
    if path is None:
        return None
    check_value("ckpt_path", str(path), ExistingPath)
    from sci_lightning.runs.checkpoint import read_checkpoint  # torch is loaded when it is needed

    checkpoint = read_checkpoint(Path(str(path)))
    return checkpoint if checkpoint.resumable else None


def _last_of(out: str | Path) -> Path:
    """Return where a run keeps its last checkpoint."""
    return Path(out) / "checkpoints" / "last.ckpt"
