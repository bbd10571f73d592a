"""The bytes of a checkpoint in torch's format, checked before torch reads them, and the content checked after.

``torch.load(weights_only=True)`` executes nothing, but it does what a file says: it inflates, allocates and sets
attributes. Two readers of one archive must also see the same: torch's own and Python's, which checks it, look for the
table of contents in different places.
Source: PKWARE, "APPNOTE.TXT - .ZIP File Format Specification", 4.3.14 to 4.3.16.
"""

from __future__ import annotations

import os
import pickletools
import struct
import sys
import zipfile
from collections import Counter, OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import torch

from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt

ARCHIVE = b"PK\x03\x04"
"""What torch takes for an archive begins with this; anything else is its format from before 2020."""

END = struct.Struct("<4s4H2IH")
"""The last bytes of an archive: signature, .., size and place of the table of contents, length of a comment."""
LARGE_PLACE = struct.Struct("<4sIQI")
"""Before it in large archives: where the next one is."""
LARGE_END = struct.Struct("<4sQ2H2I4Q")

MAKES_BYTES = "builtins bytearray"
"""Called with a number, it fills so many bytes of memory."""
ENCODES = "_codecs encode"
"""Part of a NumPy number; there are encodings that take the square of a text's length in time."""
LONGEST_ENCODED = 1000

PICKLES = 5
"""Of the format from before 2020, one after another: number, version, system, content, names of tensors."""

MOST_VALUES = 2_000_000
"""Values in a checkpoint, every list counted as often as it is referred to."""
MAX_DEPTH = 100

MOST_STEPS = 5_000_000
"""Operations of a pickle, and values that are passed to what it calls. A tensor takes thirty."""

MOST_KEYS = 1000
"""Keys in a checkpoint whose hash is no secret; those that trainings write are texts and small numbers."""

HASHING = ("OrderedDict", "Counter", "set", "frozenset", "dict")
"""What hashes its argument when it is called, by the last part of its name."""


def check_archive(path: Path) -> int:
    """Check sizes and checksums of torch's archive, and what the pickle in it calls.

    Returns:
        how many bytes of the file are left for the values of tensors.

    Raises:
        BadInput: an entry that is compressed or larger than the file, or whose bytes are not those that were written;
            an archive that two readers would read differently; a pickle that fills the memory.
    """
    with path.open("rb") as stream:
        if stream.read(len(ARCHIVE)) != ARCHIVE:
            stream.seek(0)
            _check_pickles(path, stream, PICKLES)
            return path.stat().st_size - stream.tell()
        if not _has_one_table(stream, path.stat().st_size):
            raise BadInput(f"{path}: damaged or truncated: torch's archive does not end with its one table of contents")
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
            raise BadInput(f"{path}: its entries are compressed, which torch.save never does; refused")
        if sum(entry.file_size for entry in entries) > path.stat().st_size:
            raise BadInput(f"{path}: declares more bytes than the file holds; damaged, or made to exhaust the memory")
        if damaged := archive.testzip():
            raise BadInput(f"{path}: damaged; the checksum of '{excerpt(damaged)}' is not that of its bytes")
        for entry in entries:
            if entry.filename.endswith("data.pkl"):
                with archive.open(entry) as pickled:
                    _check_pickles(path, pickled, 1)
    return path.stat().st_size


def check_values(path: Path, content: Any, room: int) -> None:
    """Check all that came out of a checkpoint, and take off the attributes that it set on its values.

    An ``OrderedDict`` or a tensor out of a file may carry attributes that stand in the place of its methods. Of a
    tensor whose values are missing in the format from before 2020 torch makes one of whatever the memory holds.

    Args:
        path: the file, for messages.
        content: what came out.
        room: bytes that are left for tensors, see :func:`check_archive`.

    Raises:
        BadInput: tensors that are no ordinary ones or not in the file; lists that refer to themselves, or unfold into
            more than :data:`MOST_VALUES`.
    """
    storages: dict[int, int] = {}
    budget = MOST_VALUES
    waiting: list[tuple[str, Any, int]] = [("", content, 0)]
    while waiting:
        name, value, depth = waiting.pop()
        budget -= 1
        if budget < 0 or depth > MAX_DEPTH:
            raise BadInput(f"{path}: too large for a checkpoint (over {MOST_VALUES:,} values or {MAX_DEPTH} levels)")
        if isinstance(value, (OrderedDict, Counter, torch.Tensor)):
            vars(value).clear()
        if isinstance(value, torch.Tensor):
            check_tensor(path, name, value)
            storage = value.untyped_storage()
            storages[storage.data_ptr()] = storage.nbytes()
        elif isinstance(value, dict):
            waiting.extend((str(key)[:200], entry, depth + 1) for key, entry in value.items())
        elif isinstance(value, (list, tuple)):
            waiting.extend((name, entry, depth + 1) for entry in value)
    if sum(storages.values()) > room:
        raise BadInput(f"{path}: declares more bytes than the file holds; damaged, or made to exhaust the memory")


def check_tensor(path: Path, name: object, tensor: torch.Tensor) -> None:
    """Check that a tensor is an ordinary one, backed by as many values as its shape says.

    A tensor of stride 0 takes four bytes in a file and declares any number of values.

    Raises:
        BadInput: it is not.
    """
    ordinary = tensor.layout is torch.strided and tensor.device.type == "cpu" and not tensor.is_quantized
    ordinary = ordinary and not (tensor.is_nested or tensor.is_conj() or tensor.is_neg())
    if not ordinary or tensor.numel() * tensor.element_size() > tensor.untyped_storage().nbytes():
        raise BadInput(f"{path}: damaged: '{excerpt(name)}' is not an ordinary tensor (its values are not in the file)")


def _has_one_table(stream: IO[bytes], size: int) -> bool:
    """Whether an archive ends right behind its table of contents, so that nobody can find another one."""
    end = size - END.size
    signature, *_, length, start, comment = END.unpack(_bytes_at(stream, end, END.size))
    if signature != b"PK\x05\x06" or comment:
        return False
    place = end - LARGE_PLACE.size
    signature, _, where, _ = LARGE_PLACE.unpack(_bytes_at(stream, place, LARGE_PLACE.size))
    if signature == b"PK\x06\x07":
        end = place - LARGE_END.size
        signature, *_, length, start = LARGE_END.unpack(_bytes_at(stream, end, LARGE_END.size))
        if signature != b"PK\x06\x06" or where != end:
            return False
    return bool(start + length == end)


def _bytes_at(stream: IO[bytes], place: int, count: int) -> bytes:
    stream.seek(max(0, place), os.SEEK_SET)
    return stream.read(count).ljust(count, b"\0")


def _check_pickles(path: Path, stream: IO[bytes], count: int) -> None:
    """Look through pickles without obeying them; what is no pickle is left to torch, which says so."""
    names: set[str] = set()
    longest = steps = 0
    for _ in range(count):
        cost = PickleCost()
        try:
            for operation, argument, _ in pickletools.genops(stream):
                if operation.name == "GLOBAL":
                    names.add(str(argument).replace("__builtin__", "builtins"))
                elif isinstance(argument, str):
                    longest = max(longest, len(argument))
                cost.follow(operation.name, argument)
                if steps + cost.steps > MOST_STEPS:
                    raise BadInput(f"{path}: too large for a checkpoint (over {MOST_STEPS:,} steps to unpickle it)")
                if cost.keys > MOST_KEYS:
                    raise BadInput(
                        f"{path}: has over {MOST_KEYS:,} keys that are huge numbers or tuples, which trainings do not "
                        "write and which can keep a dictionary busy for hours; expected texts and small numbers"
                    )
        except BadInput:
            raise
        except (ValueError, LookupError, struct.error):
            break
        steps += cost.steps
    if MAKES_BYTES in names or (ENCODES in names and longest > LONGEST_ENCODED):
        raise BadInput(
            f"{path}: holds Python objects other than tensors and plain values, which would fill the memory; refused, "
            "nothing was executed; have whoever wrote it save a state_dict instead"
        )


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

    The hash of a number is no secret: ten thousand numbers of the same hash keep a dictionary busy for minutes. Numbers
    below the modulus of Python's hash are their own hash, and those of texts are seeded anew in every process; the
    others, and tuples and what a pickle makes by calling something, are counted where they become keys: a tuple with
    all that is in it, because Python hashes a tuple that holds another one twice by hashing that one twice.
    Source: Python Language Reference, "Hashing of numeric types"; Crosby and Wallach, "Denial of Service via
    Algorithmic Complexity Attacks", USENIX Security 2003.

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
