"""What went wrong, in one line and a status."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from typing import NoReturn

from hydra._internal.utils import get_args_parser
from hydra.errors import (
    ConfigCompositionException,
    HydraException,
    InstantiationException,
    MissingConfigException,
    OverrideParseException,
)
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException
from yaml import YAMLError, safe_load

from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.errors import BadInput, as_machine_failure
from sci_lightning.files.plain_text import excerpt


def root_cause(error: BaseException) -> BaseException:
    """What made an instantiation fail, through Hydra's wrapping."""
    while isinstance(error, InstantiationException) and error.__cause__ is not None:
        error = error.__cause__
    return error


def one_line(error: BaseException) -> str:
    """What is wrong and what would be right, in one line."""
    cause = root_cause(error)
    if isinstance(cause, BadInput):
        return " ".join(str(cause).split())
    if failure := as_machine_failure(cause):
        return str(failure)
    if isinstance(cause, MissingConfigException):
        group, _, name = str(cause.missing_cfg_file).rpartition("/")
        if options := cause.options or sorted(path.stem for path in (CONF / group).glob("*.yaml") if group):
            return f"{group}={name}: no such {group}; {_nearest(name, options)}choose one of {', '.join(options)}"
    if isinstance(cause, ConfigCompositionException) and (line := _unknown_setting(cause)):
        return line
    if isinstance(cause, OverrideParseException):
        reason = re.sub(r"\s*See https?://\S+.*", "", str(cause.message), flags=re.DOTALL)
        written = "lists are [a,b], mappings {a: b} without quotes around keys"
        return f"{excerpt(cause.override)}: cannot be read ({excerpt(reason)}); {written}"
    if isinstance(cause, MissingMandatoryValue) and cause.full_key:
        return f"give {cause.full_key}=..; --help says what it is"
    text = " ".join(str(cause).split()) or type(cause).__name__
    if isinstance(cause, OmegaConfBaseException) and cause.full_key and cause.msg:
        return f"{cause.full_key}: {' '.join(str(cause.msg).split())}"
    if _is_misconfiguration(cause):
        return f"trainer, callbacks or logger: {text}"
    if isinstance(cause, (HydraException, OmegaConfBaseException)):
        return text.replace("Set hydra.verbose=true to see the full error", "").strip()
    if isinstance(cause, OSError) and cause.strerror:
        return f"{cause.filename}: {cause.strerror.lower()}" if cause.filename else cause.strerror
    return f"{type(cause).__name__}: {text} (unforeseen; debug=true shows where)"


def exit_status(error: BaseException) -> int:
    """The exit status: 2 for bad input, 1 for a failing machine (a full disk) and for what is unforeseen."""
    expected = (BadInput, HydraException, OmegaConfBaseException, OSError)
    cause = root_cause(error)
    return (
        2 if (isinstance(cause, expected) or _is_misconfiguration(cause)) and as_machine_failure(cause) is None else 1
    )


def check_words(command: str, arguments: Sequence[str]) -> None:
    """Check that a command line has no options but Hydra's, which would print its usage and no reason.

    Args:
        command: its name, for the message.
        arguments: of the command line.

    Raises:
        BadInput: an option that is none, or a word that is no ``key=value``.
    """
    parser = get_args_parser()

    def error(message: str) -> NoReturn:
        raise BadInput(f"{message}; sci_lightning.{command} --help lists settings, --hydra-help options")

    parser.error = error  # type: ignore[method-assign]  # its own prints the usage
    given, unknown = parser.parse_known_args(list(arguments))
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
        BadInput: one that is no name; the message lists the choices.
    """
    for argument in arguments:
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


def _unknown_setting(error: ConfigCompositionException) -> str | None:
    """What Hydra says of an override of a setting that does not exist, with the settings that do in its place."""
    unknown = re.match(r"Could not override '(.+?)'", str(error))
    if not unknown:
        return None
    key, line = unknown[1], f"{unknown[1]}: no such setting"
    if key == "candidates" or key.startswith("candidates."):
        names = ", ".join(sorted(path.stem for path in (CONF / "effect").glob("*.yaml")))
        own = "one of your own is added with +candidates.mine=my_module.Mine"
        return f"{line}; {own}; candidates without that are {names}"
    if effect := re.match(r"encoder\.effects\.(\w+)\.", key):
        return f"{line}; effect=[{effect[1]}] puts that effect into the encoder"
    above, _, name = key.rpartition(".")
    node = getattr(error.__cause__, "parent_node", None)
    exact = getattr(error.__cause__, "full_key", None) == key
    beside = [str(other) for other in node or () if exact and not str(other).startswith("_")]
    near = [f"{above}.{other}".lstrip(".") for other in get_close_matches(name, beside, n=1, cutoff=0.7)]
    if not near and isinstance(node, DictConfig) and node._get_parent() is None:
        near = [leaf for leaf in _leaves(node) if leaf.endswith(f".{key}")][:3]
    if near:
        return f"{line}; did you mean {' or '.join(near)}?"
    if above == "trainer":
        return f"{line} in conf/trainer; any other argument of Lightning's Trainer is added with +{key}=.."
    return f"{line}; {above} has {', '.join(beside)}" if above and beside else f"{line}; --help lists all"


def _leaves(node: DictConfig, above: str = "") -> Iterator[str]:
    """The keys of all values below ``node``, Hydra's own left out."""
    for key in map(str, node):
        name, value = f"{above}{key}", None if OmegaConf.is_missing(node, key) else node._get_node(key)
        if isinstance(value, DictConfig) and not (value._is_none() or value._is_interpolation()):
            yield from _leaves(value, f"{name}.") if name != "hydra" else ()
        elif not key.startswith("_"):
            yield name


def _nearest(name: str, names: Iterable[str]) -> str:
    """``did you mean ..?`` before a list of names of which one is much like ``name``; else nothing."""
    near = get_close_matches(name, list(names), n=1, cutoff=0.8)
    return f"did you mean {near[0]}? Else " if near else ""


def _is_misconfiguration(error: BaseException) -> bool:
    """Whether Lightning refuses a setting; its class is known by name, so that torch need not be loaded to ask."""
    return type(error).__name__ == "MisconfigurationException"
