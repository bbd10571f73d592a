"""What went wrong, in one line and a status."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any

from hydra.errors import (
    ConfigCompositionException,
    HydraException,
    InstantiationException,
    MissingConfigException,
    OverrideParseException,
)
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.errors import BadInput, as_machine_failure
from sci_lightning.plain_text import excerpt


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
        written = (
            "lists are [a,b], mappings {a: b} without quotes around keys; a path with spaces or accents stands in "
            "quotes of its own inside the shell's: \"captures='MY FILE.h5'\""
        )
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
    if isinstance(cause, (FileExistsError, NotADirectoryError)) and cause.filename:
        return f"{cause.filename}: a file stands where a folder is needed; name another folder"
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
        return f"{line}; effect={effect[1]} puts that effect into the encoder"
    above, _, name = key.rpartition(".")
    node = getattr(error.__cause__, "parent_node", None)
    exact = getattr(error.__cause__, "full_key", None) == key
    beside = [str(other) for other in node or () if exact and not str(other).startswith("_")]
    near = [f"{above}.{other}".lstrip(".") for other in get_close_matches(name, beside, n=1, cutoff=0.7)]
    if not near and isinstance(node, DictConfig) and "hydra" in node:  # the whole configuration
        settings = OmegaConf.to_container(node, resolve=False)
        near = (
            [leaf for leaf in _leaves(settings) if leaf.endswith(f".{key}")][:3] if isinstance(settings, dict) else []
        )
    if near:
        return f"{line}; did you mean {' or '.join(near)}?"
    if above == "trainer":
        return f"{line} in conf/trainer; any other argument of Lightning's Trainer is added with +{key}=.."
    return f"{line}; {above} has {', '.join(beside)}" if above and beside else f"{line}; --help lists all"


def _leaves(settings: Mapping[Any, Any], above: str = "") -> Iterator[str]:
    """Return the keys of all values in unresolved settings, Hydra's own left out."""
    for key, value in settings.items():
        name = f"{above}{key}"
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{name}.") if name != "hydra" else ()
        elif not str(key).startswith("_"):
            yield name


def _nearest(name: str, names: Iterable[str]) -> str:
    """``did you mean ..?`` before a list of names of which one is much like ``name``; else nothing."""
    near = get_close_matches(name, list(names), n=1, cutoff=0.8)
    return f"did you mean {near[0]}? Else " if near else ""


def _is_misconfiguration(error: BaseException) -> bool:
    """Whether Lightning refuses a setting; its class is known by name, so that torch need not be loaded to ask."""
    return type(error).__name__ == "MisconfigurationException"
