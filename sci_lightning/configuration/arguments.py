"""Arguments of a class, checked against its signature: names, types and ranges.

The annotations of ``__init__`` are the schema: ``channels: Width`` says that a value must be a whole number and which
ones are allowed (:mod:`sci_lightning.configuration.bounds`). pydantic does the checking.
"""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, PydanticUserError, TypeAdapter, ValidationError

from sci_lightning.configuration.annotation import in_words
from sci_lightning.configuration.bounds import Exists
from sci_lightning.configuration.library_bounds import LIBRARY_BOUNDS
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt, with_article


def check_arguments(target: Callable[..., Any], arguments: Mapping[str, Any], key: str) -> None:
    """Check keyword arguments for ``target`` before it is called.

    Args:
        target: a class or a function. What has no readable signature (some of the standard library) is not checked.
        arguments: by name; nested objects are built already.
        key: where in the configuration they stand, for messages: ``decoder`` gives ``decoder.channels=abc: ..``.

    Raises:
        BadInput: an argument that ``target`` does not take, one that is missing, or a value of another type or out of
            its range.
    """
    parameters = _parameters(target)
    if parameters is None:
        return
    known, open_ended = parameters
    name = getattr(target, "__name__", str(target))
    refuse_unknown(arguments, known, open_ended, key, name)
    bounds = LIBRARY_BOUNDS.get(f"{getattr(target, '__module__', None)}.{name}", {})
    for argument, (annotation, required) in known.items():
        if argument in arguments:
            check_value(f"{key}.{argument}", arguments[argument], bounds.get(argument, annotation))
        elif required:
            raise BadInput(f"{key}.{argument}: {name} needs it, give {key}.{argument}=..")


def refuse_unknown(arguments: Iterable[str], known: Iterable[str], open_ended: bool, key: str, name: str) -> None:
    """Raise BadInput for an argument that the class ``name`` does not take, unless it is ``open_ended``."""
    for argument in arguments:
        if argument not in known and not open_ended:
            raise BadInput(
                f"{key}.{excerpt(argument)}: {name} has no such setting; it has {', '.join(known) or 'none'}"
            )


def check_value(key: str, value: Any, annotation: Any) -> None:
    """Check one value against a type, ``Annotated`` with bounds or not.

    Numbers are not made of text nor whole numbers of booleans; lists do where tuples are expected and the reverse.

    Raises:
        BadInput: it does not fit; the message begins with ``key=value``.
    """
    if annotation is inspect.Parameter.empty or annotation is Any:
        return
    try:
        adapter = _adapter(annotation)
    except (PydanticUserError, NameError, TypeError):  # an annotation that says nothing checkable
        return
    for path in value if isinstance(value, (list, tuple)) else [value]:
        if isinstance(path, str) and is_absent(path, annotation):
            raise BadInput(f"{path}: no such file or folder; give {key}= one that exists")
    for form in (value, _as_tuples(value)):
        try:
            adapter.validate_python(form, strict=True)
            return
        except ValidationError:
            continue
    raise BadInput(f"{key}={_shown(value)}: expected {in_words(annotation)}")


def is_absent(path: str, annotation: Any) -> bool:
    """Return whether an annotation asks for a path that exists, and this one does not; patterns are not looked at."""
    kind = next((part for part in getattr(annotation, "__metadata__", ()) if isinstance(part, Exists)), None)
    if kind is None:
        return any(is_absent(path, part) for part in get_args(annotation) if get_origin(annotation) is not Literal)
    is_name = kind.or_name and not Path(path).suffix and "/" not in path
    return not is_name and not re.search(r"[*?\[]", path) and not os.path.exists(os.path.expanduser(path))


def _adapter(annotation: Any) -> TypeAdapter[Any]:
    try:
        return _cached_adapter(annotation)
    except TypeError:  # not hashable
        return TypeAdapter(annotation, config=ConfigDict(arbitrary_types_allowed=True))


@lru_cache(maxsize=512)
def _cached_adapter(annotation: Any) -> TypeAdapter[Any]:
    try:
        return TypeAdapter(annotation, config=ConfigDict(arbitrary_types_allowed=True))
    except PydanticUserError as error:
        if error.code != "type-adapter-config-unused":  # a dataclass or a model brings its own configuration
            raise
        return TypeAdapter(annotation)


@lru_cache(maxsize=256)
def _parameters(target: Callable[..., Any]) -> tuple[dict[str, tuple[Any, bool]], bool] | None:
    """(annotation, whether it is required) of each argument by name, and whether any others are taken.

    A class whose ``__init__`` passes ``**others`` on takes what its base classes take.
    """
    owners = [c for c in target.__mro__ if "__init__" in vars(c)] if inspect.isclass(target) else [target]
    if owners == [object]:  # made by __new__, as what is written in C often is
        return None
    known: dict[str, tuple[Any, bool]] = {}
    open_ended = True
    for owner in owners:
        function = vars(owner)["__init__"] if inspect.isclass(owner) else owner
        if owner is object:
            open_ended = False
            break
        try:
            parameters = list(inspect.signature(function).parameters.values())
        except (TypeError, ValueError):
            return None
        try:
            hints = get_type_hints(function, include_extras=True)
        except Exception:  # names that exist for type checkers only
            hints = {}
        for parameter in parameters[1:] if inspect.isclass(owner) else parameters:
            if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
                annotation = hints.get(parameter.name, inspect.Parameter.empty)
                required = owner is owners[0] and parameter.default is parameter.empty  # a base class's are passed on
                known.setdefault(parameter.name, (annotation, required))
        open_ended = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
        if not open_ended:
            break
        if owner.__module__.split(".")[0] == "torch":  # nn.Module refuses what is left over by itself
            break
    return known, open_ended


def _as_tuples(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return tuple(_as_tuples(entry) for entry in value)
    if isinstance(value, Mapping):
        return {key: _as_tuples(entry) for key, entry in value.items()}
    return value


def _shown(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    plain = isinstance(value, (str, int, float, list, tuple, Mapping))
    return excerpt(value, 60) if plain else with_article(type(value).__name__)
