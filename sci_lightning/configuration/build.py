"""Objects made of configurations: mappings whose ``_target_`` names a class, the other entries being its arguments."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from sci_lightning.configuration.arguments import check_arguments
from sci_lightning.configuration.registry import class_for_file
from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.plain_text import excerpt

Resolve = Callable[[str, Any], Callable[..., Any]]
"""From the key of a ``_target_`` and its value to what is to be called."""


def build(config: Mapping[str, Any], key: str, **more: Any) -> Any:
    """Build what the user configured: any class or function may be named.

    ``_partial_: true`` gives a function that takes the remaining arguments, as with Hydra's ``instantiate``.

    Args:
        config: dictionaries, lists and values, resolved (``plain`` makes them of a configuration).
        key: where in the configuration it stands, for messages.
        more: further arguments of the outermost object, built already; they take precedence.

    Raises:
        BadInput: no ``_target_``, one that leads nowhere, arguments that do not fit (see
            :func:`~sci_lightning.configuration.arguments.check_arguments`), or whatever the object itself finds wrong
            with a value.
    """
    return _build(config, key, _imported, more)


def build_from_file(config: Mapping[str, Any], path: str | Path, key: str, trusted: Iterable[str] = ()) -> Any:
    """Build what a file configures: only classes of our own or of trusted packages, whatever else it asks for.

    What is checked is what is called: names are looked up in
    :func:`~sci_lightning.configuration.registry.class_for_file` at the moment of building.

    Args:
        config: plain data (:func:`~sci_lightning.files.plain_data.check_plain_data`).
        path: the file, for messages.
        key: where in the file it stands.
        trusted: packages beside this one.

    Raises:
        BadInput: as :func:`build`; a name that the file may not use; ``_partial_`` or the like.
    """
    packages = tuple(trusted)

    def resolve(key: str, target: Any) -> Callable[..., Any]:
        return class_for_file(path, target, packages)

    try:
        return _build(config, key, resolve, {}, special=())
    except BadInput as error:
        raise error if str(error).startswith(str(path)) else BadInput(f"{path}: {error}") from error


def _build(
    config: Any, key: str, resolve: Resolve, more: Mapping[str, Any], special: tuple[str, ...] = ("_partial_",)
) -> Any:
    if not isinstance(config, Mapping) or "_target_" not in config:
        raise BadInput(f"{key}: expected a mapping with _target_, which names a class")
    target = resolve(key, config["_target_"])
    entries = {str(name): value for name, value in config.items() if name != "_target_"}
    if wrong := [name for name in entries if name.startswith("_") and name.endswith("_") and name not in special]:
        raise BadInput(f"{key}.{wrong[0]}: not a setting; the arguments of a class are given by name")
    partial = entries.pop("_partial_", False)
    arguments = {name: _value(value, f"{key}.{name}", resolve, special) for name, value in entries.items()}
    arguments.update(more)
    if partial:
        return functools.partial(target, **arguments)
    check_arguments(target, arguments, key)
    try:
        return target(**arguments)
    except (BadInput, MachineFailure, OSError):  # which say by themselves what is wrong
        raise
    except MemoryError as error:
        raise BadInput(f"{key}: with these values it does not fit into this machine's memory") from error
    except Exception as error:  # every library has exceptions of its own for a value that it does not take
        reason = " ".join(str(error).split()) or type(error).__name__
        named = (name for name, value in arguments.items() if isinstance(value, str) and f"'{value}'" in reason)
        culprit = next((f"{key}.{name}={excerpt(arguments[name], 60)}" for name in named), key)
        raise BadInput(f"{culprit}: {getattr(target, '__name__', target)} does not take it ({reason})") from error


def _value(value: Any, key: str, resolve: Resolve, special: tuple[str, ...]) -> Any:
    if isinstance(value, Mapping):
        if "_target_" in value:
            return _build(value, key, resolve, {}, special)
        return {name: _value(entry, f"{key}.{name}", resolve, special) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_value(entry, f"{key}[{index}]", resolve, special) for index, entry in enumerate(value)]
    return value


def _imported(key: str, target: Any) -> Callable[..., Any]:
    """What a dotted path leads to; a class within a class as well."""
    parts = str(target).split(".")
    if not isinstance(target, str) or len(parts) < 2 or not all(part.isidentifier() for part in parts):
        raise BadInput(f"{key}._target_={target}: expected the path of a class, such as my_module.MyClass")
    for end in range(len(parts) - 1, 0, -1):
        name = ".".join(parts[:end])
        try:
            member: Any = importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name is not None and (name == error.name or name.startswith(f"{error.name}.")):
                continue  # a class, or there is no such module
            raise BadInput(f"{key}._target_={target}: importing it needs the package '{error.name}'") from error
        except Exception as error:  # whatever somebody's module does when it is imported
            raise BadInput(f"{key}._target_={target}: cannot be imported ({type(error).__name__}: {error})") from error
        try:
            for part in parts[end:]:
                member = getattr(member, part)
        except AttributeError as error:
            raise BadInput(f"{key}._target_={target}: no such class ({error})") from error
        if not callable(member):
            raise BadInput(f"{key}._target_={target}: not a class or a function")
        return member
    raise BadInput(f"{key}._target_={target}: there is no module '{parts[0]}'")
