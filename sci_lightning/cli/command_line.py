"""The words of a command line, checked before Hydra sees them: it would answer with its usage and no reason."""

from __future__ import annotations

import re
from argparse import ArgumentParser
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from typing import NoReturn

from yaml import YAMLError, safe_load

from sci_lightning.cli.next_command import override
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt

FLAGS = (
    ("--help", "-h"),
    ("--hydra-help",),
    ("--version",),
    ("--resolve",),
    ("--run", "-r"),
    ("--multirun", "-m"),
    ("--shell-completion", "-sc"),
)
"""Hydra's options that stand alone; it has no public list of them, and ``--hydra-help`` prints these."""

OPTIONS = (
    ("--package", "-p"),
    ("--config-path", "-cp"),
    ("--config-name", "-cn"),
    ("--config-dir", "-cd"),
    ("--experimental-rerun",),
)
"""Hydra's options that are followed by a value."""

SHOWN = ("job", "hydra", "all")
"""Values of Hydra's ``--cfg``."""
ABOUT = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")
"""Values of Hydra's ``--info``, which may stand alone."""

PLUGINS = {
    "hydra/launcher=joblib": ("hydra_joblib_launcher", "launchers"),
    "hydra/launcher=submitit_local": ("hydra_submitit_launcher", "launchers"),
    "hydra/launcher=slurm": ("hydra_submitit_launcher", "launchers"),
    "hydra/launcher=ray": ("hydra_ray_launcher", "ray"),
    "hydra/sweeper=optuna": ("hydra_optuna_sweeper", "optuna"),
    "hparams_search=optuna": ("hydra_optuna_sweeper", "optuna"),
}
"""Choices that need a plug-in of Hydra: its module, and the extra of this package that brings it."""


class _Parser(ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise BadInput(f"{message}; {self.prog} --help lists settings, --hydra-help options")


def hydra_options(command: str) -> ArgumentParser:
    """Return a parser of Hydra's options and of overrides; it raises BadInput where Hydra's prints its usage."""
    parser = _Parser(f"sci_lightning.{command}", add_help=False)
    for names in FLAGS:
        parser.add_argument(*names, action="store_true")
    for names in OPTIONS:
        parser.add_argument(*names)
    parser.add_argument("--cfg", "-c", choices=SHOWN)
    parser.add_argument("--info", "-i", nargs="?", const="all", choices=ABOUT)
    parser.add_argument("overrides", nargs="*")
    return parser


def check_words(command: str, arguments: Sequence[str]) -> None:
    """Check that a command line has no options but Hydra's, and settings that are ``key=value``.

    Args:
        command: its name, for the message.
        arguments: of the command line.

    Raises:
        BadInput: an option that is none, or a word that is no ``key=value``.
    """
    given, unknown = hydra_options(command).parse_known_args(list(arguments))
    if options := [word for word in unknown if word.startswith("-")]:
        place = list(arguments).index(options[0])
        name, equals, value = options[0].lstrip("-").partition("=")
        following = [] if equals else [word for word in arguments[place + 1 : place + 2] if not word.startswith("-")]
        right = f"{name.replace('-', '_')}={value or (following or ['..'])[0]}"
        raise BadInput(f"{options[0]}: no such option; settings are written without dashes, {right}; --help lists them")
    if unknown:
        raise BadInput(f"{excerpt(unknown[0])}: write options, which begin with dashes, before all settings")
    for word in given.overrides:
        if "=" not in word and not word.startswith("~"):
            raise BadInput(f"{excerpt(word)}: expected key=value; --help lists the settings")


def check_choices(arguments: Iterable[str]) -> None:
    """Check that overrides of configuration groups are names, before Hydra meets a number or null.

    Args:
        arguments: of the command line.

    Raises:
        BadInput: one that is no name, the message lists the choices; or one whose plug-in is not installed.
    """
    for argument in arguments:
        module, extra = PLUGINS.get(argument, (None, None))
        if module is not None and find_spec(f"hydra_plugins.{module}") is None:
            raise BadInput(f"{argument}: not installed; pip install 'sci-lightning[{extra}]'")
        key, equals, value = argument.partition("=")
        group = key.lstrip("+").partition("@")[0]
        if not equals or not group or not (CONF / group).is_dir():
            continue
        try:
            kind = type(safe_load(value))
        except YAMLError:  # Hydra's grammar knows more than YAML
            continue
        if kind not in (str, list):
            options = ", ".join(sorted(path.stem for path in (CONF / group).glob("*.yaml")))
            raise BadInput(f"{group}={excerpt(value)}: no such {group}; choose one of {options}")


def with_keys(words: Sequence[str], keys: Sequence[str]) -> list[str]:
    """Return a command line in which every plain word is written as a setting, quoted as Hydra takes it.

    Args:
        words: of the command line.
        keys: the settings that plain words stand for, in order. Plain words beyond them stay as they are, and are
            refused where the settings are checked.
    """
    remaining = iter(keys)
    valued = {"--cfg", "-c", "--info", "-i", *(name for names in OPTIONS for name in names)}
    written: list[str] = []
    for before, word in zip(("", *words), words, strict=False):
        # the key of a setting has no slash, but a path may be runs/lr=0.1/report.json
        is_plain = not re.match(r"-|~|\+*[\w.@]+=|hydra/", word)
        if is_plain and before not in valued and (key := next(remaining, None)) is not None:
            word = override(key, word)
        written.append(word)
    return written
