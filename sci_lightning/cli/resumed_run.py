"""``train ckpt_path=RUN/checkpoints/last.ckpt`` alone: the command line of the run that is gone on with.

What a checkpoint may ask for by itself is in :mod:`sci_lightning.cli.stored_overrides`. Everything else of a command
line (a folder of own configurations, classes, servers, files elsewhere) has to be said again, see :func:`repeated`.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.types import Override
from omegaconf import OmegaConf

from sci_lightning.cli.composition import Composition
from sci_lightning.cli.next_command import nearest
from sci_lightning.cli.next_command import override as quoted
from sci_lightning.cli.stored_overrides import GROUPS, VALUES, bare, checked, is_kept, overrides_of
from sci_lightning.configuration.arguments import check_value
from sci_lightning.configuration.bounds import ExistingPath
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.console import PlainConsole, styled
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt, one_printable_line
from sci_lightning.runs.encoder_file import EncoderFile, checked_encoder
from sci_lightning.runs.resume import another_training
from sci_lightning.runs.run_folder import is_first_process

PATHS = {"root", "val_root", "file"}
"""What settings that name files or folders to read are called."""

FINETUNE = "finetune"
"""The experiment that takes a decoder and starts a new training with it."""

NOT_AGAIN = {"ckpt_path", "resume", "dry_run", "debug", "out"}
"""Settings of one command line that are not those of the run; its folder is where its checkpoint lies."""

CONFIG_FOLDERS = re.compile(r"\+*hydra\.searchpath=|--config-(dir|path)|-c[dp]\b")
"""Words of a command line that say where configurations of somebody's own lie."""


@dataclass(frozen=True)
class StoredRun:
    """The run that a checkpoint belongs to.

    Attributes:
        path: of the checkpoint.
        config: its configuration, which is compared and never built.
        overrides: those of its command line that the checkpoint keeps; none of an earlier version's.
    """

    path: Path
    config: Mapping[str, Any]
    overrides: Sequence[Override]

    def choices(self) -> dict[str, str]:
        """Return what the run chose of each group, and its plain values, by key."""
        return {**{o.key_or_group: str(bare(o.value())) for o in self.overrides}, **self.config["names"]}

    def check_members(self, overrides: Iterable[Override], words: Iterable[str]) -> None:
        """Raise BadInput for members of groups that do not come with the package, if nothing says where they lie."""
        if any(CONFIG_FOLDERS.match(word) for word in words):
            return
        for override in overrides:
            group, value = override.key_or_group, override.value()
            if group.partition("/")[0] not in {*GROUPS} - {"encoder"} or "." in group:
                continue
            for name in map(bare, value if isinstance(value, list) else [value]):
                if name is not None and not (CONF / group / f"{name}.yaml").is_file():
                    raise BadInput(
                        f"{self.path}: its training used {group}={name}, which does not come with the package: say "
                        "again where that lies, 'hydra.searchpath=[FOLDER]'"
                    )

    def values(self, without: Iterable[str]) -> Iterator[str]:
        """Yield settings of the run itself that its overrides do not name: another version's may begin differently."""
        for key in VALUES:
            if key not in without and isinstance(self.config.get(key), (int, float, list)):
                yield f"{key}={str(self.config[key]).replace(' ', '')}"


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
        BadInput: a checkpoint that cannot be read, overrides in it that a checkpoint may not hold, or something that
            the arguments have to say again: files to read that lie neither in the current folder nor in the run's,
            folders of somebody's own configurations.
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
    run = StoredRun(path, checkpoint.config, overrides_of(path, checkpoint.config))
    if FINETUNE in _names(given.get("experiment", "")):
        return _finetuned(run, arguments, given), {}
    if given.get("finetune", "").lower() == "true" and not run.config.get("finetune"):
        raise BadInput(
            f"{path}: give experiment={FINETUNE} in the place of finetune=true: it begins a training of its own, in a "
            "folder of its own"
        )
    before = run.choices()
    for group in ("encoder", "decoder", "data", "system"):  # others would not even fit the settings of this one
        now = given.get(group, "")
        if run.overrides and group in before and now not in ("", before[group]) and not now.endswith(".yaml"):
            raise BadInput(another_training(path, group, before[group], now))
    files: dict[str, EncoderFile] = {}
    named_paths: list[tuple[str, str]] = []
    kept = [override for override in run.overrides if override.key_or_group not in given]
    run.check_members(kept, arguments)
    for override in kept:
        key, name = override.key_or_group, str(bare(override.value()))
        if key == "encoder" and name not in encoders:  # of a file, as it was then
            files[name] = EncoderFile(path, checked_encoder(path, run.config["encoder"]))
            ConfigStore.instance().store(group="encoder", name=name, node=OmegaConf.create(files[name].content))
            named_paths += _paths("encoder", files[name].content)
        named_paths += _paths(key, override.value())
    _check_paths(path, [(key, value) for key, value in named_paths if key not in given])
    words = [str(override.input_line) for override in kept]
    named = {override.key_or_group for override in run.overrides} | given.keys()
    if run.overrides:
        words += run.values(without=named)
    folder = Path(os.path.abspath(path)).parent  # not resolved: what is named is written, wherever links lead
    if "out" not in given and path.name == "last.ckpt" and folder.name == "checkpoints":
        _check_folder(folder.parent)
        words.append(f"out='{folder.parent}'")
    return [*words, *arguments], files


def _finetuned(run: StoredRun, arguments: list[str], given: Mapping[str, str]) -> list[str]:
    """Return the arguments of a new training of the decoder that a checkpoint holds, behind another encoder.

    Decoder, data and scale are as they were in that training, the encoder is the one that is given, and the recipe sets
    what it sets: the plan and the learning rates of the training before are left out, and what was shown and logged.
    """
    path, config = run.path, run.config
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
    experiments = _names(given["experiment"])
    field = ("frames", "size") if given["encoder"].endswith(".yaml") else ()  # which the encoder file says
    leave_out = {*given, *recipe, *field}
    kept = []
    for override in run.overrides:
        key, value = override.key_or_group, override.value()
        if key == "experiment":
            earlier = [str(bare(name)) for name in (value if isinstance(value, list) else [value])]
            experiments = [name for name in earlier if name not in experiments] + experiments
        elif key not in leave_out and re.split(r"[./]", key)[0] not in ("encoder", "effect", "logger", "callbacks"):
            kept.append(override)
    run.check_members(kept, arguments)
    _check_paths(path, [named for override in kept for named in _paths(override.key_or_group, override.value())])
    leave_out |= {override.key_or_group for override in run.overrides}
    leave_out |= {"crop"} if config.get("crop") == config.get("size") else set()
    words = [*(str(override.input_line) for override in kept), *run.values(without=leave_out)]
    rest = [word for word in arguments if word.partition("=")[0].lstrip("+~") != "experiment"]
    return [f"experiment=[{','.join(experiments)}]", *words, *rest]


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
    for folder_path, folders, files in os.walk(real):
        for name in (*folders, *files):
            path = Path(folder_path) / name
            if path.is_symlink() and not path.resolve().is_relative_to(real):
                raise BadInput(
                    f"{path}: a link that leads out of the run's folder, where other files would be overwritten; to "
                    f"go on there all the same, say so: out={folder}"
                )


def _paths(key: str, value: Any) -> Iterator[tuple[str, str]]:
    """Settings that name files to read, and what they name: by what they are called, and whatever looks like a path."""
    if isinstance(value, Mapping):
        for name, entry in value.items():
            yield from _paths(f"{key}.{bare(name)}", entry)
    elif isinstance(value, list):
        for entry in value:
            yield from _paths(key, entry)
    elif isinstance(text := bare(value), str) and (
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
            f"yours, say so by repeating: {shlex.join(map(one_printable_line, elsewhere))}"
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


def repeated(path: Path, composition: Composition, encoder: Mapping[str, Any]) -> list[str]:
    """Return what has to stand beside ``ckpt_path=`` to go on with one's own run: what its checkpoint may not ask for.

    Args:
        path: of the checkpoint.
        composition: of the run.
        encoder: the configuration of its encoder.
    """
    named, words = list(_paths("encoder", encoder)), []
    for line in composition.overrides:
        if is_kept(line):
            override = checked(path, line)
            named += _paths(override.key_or_group, override.value())
        elif line.lstrip("+~").partition("=")[0] not in NOT_AGAIN:
            words.append(line)
    folder = Path(composition.cfg.out).absolute()
    elsewhere = [] if path.absolute() == _last_of(folder) else [quoted("out", nearest(folder))]
    return [*composition.own_folders(), *_elsewhere(path, named), *words, *elsewhere]


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
