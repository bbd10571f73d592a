"""``--help`` of a command: its settings, choices and defaults, with the comments of the files in ``conf/``."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sci_lightning.cli.settings import settings_of

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

WIDTH = 22
"""Column at which explanations begin; longer settings push theirs further right."""

UNLISTED = ("scale/denoiser", "hydra/")
"""Groups that no user chooses from: what ``scale=`` sets, and how Hydra is set up."""


@dataclass(frozen=True)
class Setting:
    """One line of a YAML file.

    Attributes:
        key: dotted path, or the group's name in a defaults list.
        value: as the file has it.
        about: the comment beside it, or above it.
    """

    key: str
    value: str
    about: str = ""

    def __str__(self) -> str:
        return f"  {f'{self.key}={self.value}':<{WIDTH}}  {self.about}".rstrip()


def help_text(conf: Path, name: str, arguments: Sequence[str] = ()) -> str:
    """Return what ``--help`` prints.

    Args:
        conf: the folder of configurations.
        name: of the command's own configuration in it, without ``.yaml``.
        arguments: of the command line; ``decoder=stformer`` shows that decoder's settings in place of the default's.
    """
    text = (conf / f"{name}.yaml").read_text()
    defaults, own = read_defaults(text), read_settings(text)
    chosen = dict(argument.split("=", 1) for argument in arguments if "=" in argument)
    lines = [first_comment(text)]
    members: list[tuple[str, str]] = []
    listed: set[str] = set()
    for default in defaults:
        group = default.key.partition("@")[0]
        if group in listed or group.startswith(UNLISTED) or not (conf / group).is_dir():
            continue
        if not listed:
            lines += ["", "Choices, GROUP=NAME on the command line (starred: the default, or what you gave):"]
        listed.add(group)
        value = chosen.get(group, default.value)
        lines += ["", f"{group}={value}  {default.about}".rstrip(), *_members(conf, group, value)]
        members += [(group, value)] if (conf / group / f"{value}.yaml").is_file() else []
        for inner in read_defaults(_text(conf, group, value)):
            part = f"{group}/{inner.key}"
            if (conf / part).is_dir() and part not in listed:
                listed.add(part)
                choice = chosen.get(part, inner.value)
                lines += ["", f"{part}={choice}", *_members(conf, part, choice)]
                members.append((part, choice))
    lines += ["", "Settings, KEY=VALUE on the command line (here: the defaults):", ""]
    lines += [str(setting) for setting in own]
    for default in re.findall(r"^  - (\w+)_defaults\b", text, re.MULTILINE):
        lines += ["", *map(str, dataclass_settings(default, settings_of(name)[default]))]
    for group, value in members:
        settings = [
            s for s in read_settings(_text(conf, group, value)) if "_target_" not in s.key and s.value[:2] != "${"
        ]
        if group in ("effect", "experiment", "scale") or not settings:
            continue
        key = {"metric": "metrics"}.get(group, group.replace("/", "."))
        lines += ["", f"with {group}={value}:", ""]
        lines += [str(Setting(f"{key}.{s.key}", s.value, s.about)) for s in settings]
    lines += [
        "",
        "-m runs every combination of values with commas: KEY=VALUE,VALUE. --cfg job prints what would run, "
        "--hydra-help explains Hydra's own flags.",
    ]
    return "\n".join(lines)


def first_comment(text: str) -> str:
    """The first comment of a YAML file that says what it is for."""
    comments = [line.lstrip("# ") for line in text.splitlines() if line.startswith("#")]
    return next((comment for comment in comments if not comment.startswith("@package")), "")


def read_defaults(text: str) -> list[Setting]:
    """The defaults list of a configuration: groups and their default choices."""
    block = re.search(r"^defaults:\n((?:  .*\n|#.*\n)*)", text, re.MULTILINE)
    own_settings = []
    for line in block[1].splitlines() if block else []:
        match = re.match(r"  - ([\w/@.]+): *(\[.*?\]|[^#]*?) *(?:#\s*(.*))?$", line)
        if match:
            own_settings.append(Setting(match[1], match[2], match[3] or ""))
    return own_settings


def read_settings(text: str) -> list[Setting]:
    """The settings of a configuration with their comments, nested ones by their dotted path."""
    text = re.sub(r"^defaults:\n(?:  .*\n|#.*\n)*", "", text, flags=re.MULTILINE)
    own_settings: list[Setting] = []
    path: list[str] = []
    above: list[str] = []
    for line in text.splitlines():
        if comment := re.match(r"# ?(.*)", line):
            above.append(comment[1])
            continue
        match = re.match(r"( *)([\w@]+):(?: +(.*))?$", line)
        if not match:
            above = []
            continue
        indent, key, rest = len(match[1]) // 2, match[2], match[3] or ""
        rest = re.sub(r"\$\{oc\.select:\w+,(.*?)\}", r"\1", rest)  # what stands where nothing else is set
        rest = re.sub(r"\$\{by:[\w.]+, (.*), \{[^{}]*\}\}", r"\1", rest)
        value, _, about = (part.strip() for part in rest.partition("#"))
        path = [*path[:indent], key]
        if path[0] != "hydra" and value:
            own_settings.append(Setting(".".join(path), value, " ".join([*above, about]).strip()))
        above = [about] if about and not value else []
    return own_settings


def dataclass_settings(key: str, settings: type[DataclassInstance]) -> list[Setting]:
    """The settings of a dataclass, with its defaults and the first clause of what its docstring says of each."""
    text = inspect.cleandoc(settings.__doc__ or "")
    about = dict(re.findall(r"^    (\w+): (.+(?:\n {8}.+)*)", text, re.MULTILINE))
    clauses = {name: re.split(r"[;.:](?: |$)", " ".join(words.split()))[0] for name, words in about.items()}
    return [Setting(f"{key}.{name}", json.dumps(value), clauses[name]) for name, value in asdict(settings()).items()]


def _members(conf: Path, group: str, chosen: str) -> list[str]:
    names = sorted(path.stem for path in (conf / group).glob("*.yaml"))
    marked = chosen.strip("[]").replace(" ", "").split(",")
    return [
        f"  {'*' if name in marked else ' '} {name:<{WIDTH - 2}}{first_comment(_text(conf, group, name))}".rstrip()
        for name in names
    ]


def _text(conf: Path, group: str, name: str) -> str:
    path = conf / group / f"{name}.yaml"
    return path.read_text() if path.is_file() else ""
