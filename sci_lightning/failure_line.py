"""What went wrong, in one line and a status."""

from __future__ import annotations

from collections.abc import Iterable

from hydra.errors import HydraException, InstantiationException, MissingConfigException
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError, safe_load

from sci_lightning.conf_folder import CONF
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
            return f"{group}={name}: no such {group}; choose one of {', '.join(options)}"
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


def _is_misconfiguration(error: BaseException) -> bool:
    """Whether Lightning refuses a setting; its class is known by name, so that torch need not be loaded to ask."""
    return type(error).__name__ == "MisconfigurationException"
