"""A type annotation in words, for messages: what would be right."""

from __future__ import annotations

import collections.abc
import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Interval, Len

PLAIN = {int: "a whole number", float: "a number", str: "text", bool: "true or false", types.NoneType: "null"}
SEQUENCES = (list, tuple, set, collections.abc.Sequence, collections.abc.Iterable)


def in_words(annotation: Any) -> str:
    """Return a phrase such as ``a whole number from 1 to 8, or null`` that follows the word "expected"."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return in_words(arguments[0]) + "".join(_bound(bound) for bound in arguments[1:])
    if origin in (Union, types.UnionType):
        phrases = (in_words(form) for form in arguments)
        forms = list(dict.fromkeys(part for phrase in phrases for part in phrase.split(", ")))
        return forms[0] if len(forms) == 1 else f"{', '.join(forms[:-1])} or {forms[-1]}"
    if origin is Literal:
        return ", ".join(str(choice) for choice in arguments)
    if (origin or annotation) in SEQUENCES:
        entries = [argument for argument in arguments if argument is not Ellipsis]
        return f"a list of {_plural(in_words(entries[0]))}" if entries else "a list"
    if (origin or annotation) in (dict, collections.abc.Mapping):
        return "a mapping"
    if annotation in PLAIN:
        return PLAIN[annotation]
    return f"a {getattr(annotation, '__name__', str(annotation))}"


def _bound(bound: Any) -> str:
    if isinstance(bound, Len):
        return f" ({bound.min_length} of them)" if bound.min_length == bound.max_length else ""
    if not isinstance(bound, Interval):
        return ""
    low = None if bound.ge is None and bound.gt is None else bound.gt if bound.ge is None else bound.ge
    high = bound.le
    if low is not None and high is not None:
        return f" from {low} to {high}"
    if bound.gt == 0:
        return " above 0"
    if low is not None:
        return f" of at least {low}"
    return f" of at most {high}" if high is not None else ""


def _plural(phrase: str) -> str:
    for one, many in (("a whole number", "whole numbers"), ("a number", "numbers"), ("text", "texts")):
        if phrase.startswith(one):
            return many + phrase.removeprefix(one)
    return phrase.removeprefix("a ")
