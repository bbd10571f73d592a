"""What a pickle costs to read, found before any of it is made: the keys of its dictionaries, and what it calls.

The hash of a number is no secret: ten thousand numbers of the same hash keep a dictionary busy for minutes. Numbers
below the modulus of Python's hash are their own hash, and those of texts are seeded anew in every process; the others,
and tuples and what a pickle makes by calling something, are counted where they become keys: a tuple with all that is
in it, because Python hashes a tuple that holds another one twice by hashing that one twice.
Source: Python Language Reference, "Hashing of numeric types"; Crosby and Wallach, "Denial of Service via Algorithmic
Complexity Attacks", USENIX Security 2003.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

HASHING = ("OrderedDict", "Counter", "set", "frozenset", "dict")
"""What hashes its argument when it is called, by the last part of its name."""


@dataclass(slots=True, eq=False)
class Value:
    """What is known of a value on the pickle's stack.

    Attributes:
        known: how many values in it, itself included, have a hash that whoever wrote the file can choose.
        name: of a class or function.
        items: of a tuple, a list or a dictionary.
    """

    known: int = 0
    name: str = ""
    items: list[Value] = field(default_factory=list)


PLAIN, CHOSEN = Value(), Value(known=1)


class PickleCost:
    """Follows the operations of one pickle as torch's reader does, without making anything of them.

    Attributes:
        keys: how many keys of known hash the pickle has so far.
        steps: how many operations, and values that are passed to what it calls, counted once for each call.
    """

    def __init__(self) -> None:
        self.keys = self.steps = 0
        self._stack: list[Value] = []
        self._below: list[list[Value]] = []
        self._memo: dict[int, Value] = {}

    def follow(self, operation: str, argument: Any) -> None:
        """Take one more operation, as ``pickletools`` names it.

        Raises:
            IndexError, KeyError: the pickle takes what it has not put there; torch's reader ends there as well.
        """
        self.steps += 1
        stack = self._stack
        match operation:
            case "MARK":
                self._below.append(stack)
                self._stack = []
            case "BINPUT" | "LONG_BINPUT":
                self._memo[argument] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                stack.append(self._memo[argument])
            case "EMPTY_LIST" | "EMPTY_DICT":
                stack.append(Value())
            case "TUPLE":
                items = self._to_mark()
                self._stack.append(_tuple(items))
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                count = int(operation[-1])
                stack[-count:] = [_tuple(stack[-count:])]
            case "APPEND":
                self._hold([stack.pop()])
            case "APPENDS":
                self._hold(self._to_mark())
            case "SETITEM":
                self._set([stack.pop(-2), stack.pop()])
            case "SETITEMS":
                self._set(self._to_mark())
            case "REDUCE" | "NEWOBJ":
                known = self._known(stack.pop().items)
                if stack[-1].name.rpartition(" ")[2] in HASHING:
                    self.keys += known
                stack[-1] = Value(known=1)
            case "BUILD":
                self._known([stack.pop()])
            case "BINPERSID":  # (.., the key of a storage, .., and the key of a view of it, ..)
                self.keys += max(0, self._known(stack.pop().items) - 1)
                stack.append(PLAIN)
            case "GLOBAL":
                stack.append(Value(name=str(argument)))
            case "PROTO" | "STOP":
                pass
            case _:
                chosen = isinstance(argument, int) and abs(argument) >= sys.hash_info.modulus
                stack.append(CHOSEN if chosen else PLAIN)

    def _to_mark(self) -> list[Value]:
        items, self._stack = self._stack, self._below.pop()
        return items

    def _hold(self, items: list[Value]) -> None:
        if self._stack[-1] is not PLAIN and self._stack[-1] is not CHOSEN:
            self._stack[-1].items += items

    def _set(self, items: list[Value]) -> None:
        self.keys += sum(key.known for key in items[::2])
        self._hold(items)

    def _known(self, values: Iterable[Value]) -> int:
        """How many values of known hash there are among these and in them; every list is looked at once."""
        known, seen, waiting = 0, set(), list(values)
        while waiting:
            value = waiting.pop()
            self.steps += 1
            known += value.known
            if value.items and id(value) not in seen:
                seen.add(id(value))
                waiting += value.items
        return known


def _tuple(items: list[Value]) -> Value:
    return Value(1 + sum(item.known for item in items), items=items)
