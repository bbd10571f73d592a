"""A type annotation in words, for messages: what would be right."""

from __future__ import annotations

import collections.abc
import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import DocInfo, Interval, Len

from sci_lightning.plain_text import with_article

PLAIN = {int: "a whole number", float: "a number", str: "text", bool: "true or false", types.NoneType: "null"}
SEQUENCES = (list, tuple, set, collections.abc.Sequence, collections.abc.Iterable)


def in_words(annotation: Any) -> str:
    """Return a phrase such as ``a whole number from 1 to 8, or null`` that follows the word "expected"."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        if described := next((bound for bound in arguments[1:] if isinstance(bound, DocInfo)), None):
            return described.documentation
        return in_words(arguments[0]) + "".join(_bound(bound) for bound in arguments[1:])
    if origin in (Union, types.UnionType):
        phrases = (in_words(form) for form in arguments)
        forms = list(dict.fromkeys(part for phrase in phrases for part in phrase.split(", ")))
        return forms[0] if len(forms) == 1 else f"{', '.join(forms[:-1])} or {forms[-1]}"
    if origin is Literal:
        return ", ".join(str(choice) for choice in arguments)
    if (origin or annotation) in SEQUENCES:
        entries = [argument for argument in arguments if argument is not Ellipsis]
        if entries and get_origin(entries[0]) is Literal:
            return f"a list of {in_words(entries[0])}"
        return f"a list of {_plural(in_words(entries[0]))}" if entries else "a list"
    if (origin or annotation) in (dict, collections.abc.Mapping):
        return "a mapping"
    if annotation in PLAIN:
        return PLAIN[annotation]
    return with_article(getattr(annotation, "__name__", str(annotation)))


def _bound(bound: Any) -> str:
    if isinstance(bound, Len):
        return f" ({bound.min_length} of them)" if bound.min_length == bound.max_length else ""
    if not isinstance(bound, Interval):
        return ""
    if bound.ge is not None and bound.le is not None:
        return f" from {bound.ge} to {bound.le}"
    low = f" above {bound.gt}" if bound.gt is not None else "" if bound.ge is None else f" of at least {bound.ge}"
    high = "" if bound.le is None else f" at most {bound.le}"
    return f"{low} and{high}" if low and high else low or high


def _plural(phrase: str) -> str:
    for one, many in (("a whole number", "whole numbers"), ("a number", "numbers"), ("text", "texts")):
        if phrase.startswith(one):
            return many + phrase.removeprefix(one)
    return f"{phrase.removeprefix('an ').removeprefix('a ')}s"
