"""What an open HDF5 file holds, by name, with one clear line where it is not what was expected."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.hdf5_file import check_dataset, own_dataset, read_dataset
from sci_lightning.files.hdf5_heap import longest_string, longest_strings
from sci_lightning.files.memory_bound import SMALL

TYPES = {"ui": "integers", "buif": "numbers"}
LONGEST_STRING = 1000
"""Characters of a label."""


@dataclass(frozen=True)
class Contents:
    """An open file and its name in messages."""

    file: h5py.File
    called: str

    def refusal(self, text: str) -> BadInput:
        """The error that says ``text`` of this file."""
        return BadInput(f"{self.called}: {' '.join(text.split())}")

    def dataset(self, name: str, shape: dict[str, int | None], *, optional: bool = False) -> h5py.Dataset | None:
        """A dataset that is in this very file.

        Args:
            name: of the dataset.
            shape: the length of each axis by its letter, in order, such as ``{"N": 34, "T": None}``; None: any but 0.
            optional: None is returned where there is none.

        Raises:
            BadInput: missing, no dataset, other dimensions or lengths, or what
                :func:`~sci_lightning.files.hdf5_file.check_dataset` refuses: kept in another file, too large, ...
        """
        letters = f"({', '.join(shape)}{',' if len(shape) == 1 else ''})"
        try:
            item = own_dataset(self.file, name, f"a dataset {letters}")
        except BadInput as error:
            raise self.refusal(str(error)) from error
        if item is None:
            if optional:
                return None
            names = ", ".join(list(self.file)[:20]) or "nothing"
            raise self.refusal(f"no dataset '{name}' {letters}; the file holds {names}")
        found_shape = item.shape if item.shape is not None else ()
        holds = f"'{name}' is {item.dtype} of shape {found_shape}"
        if len(found_shape) != len(shape):
            raise self.refusal(f"{holds}, expected {len(shape)} dimension{'s' * (len(shape) > 1)} {letters}")
        if 0 in found_shape:
            raise self.refusal(f"{holds}, which is empty; expected {letters} with at least one of each")
        expected = tuple(given or found for given, found in zip(shape.values(), found_shape, strict=True))
        if found_shape != expected:
            raise self.refusal(f"{holds}, expected {letters} = {expected}")
        try:
            check_dataset(name, item)
        except BadInput as error:
            raise self.refusal(str(error)) from error
        return item

    def numbers(self, name: str, types: str, shape: dict[str, int | None], *, optional: bool = False) -> Any:
        """A dataset of numbers as an array, None where there is none and it is ``optional``.

        Numbers of double precision become single precision while they are read.

        Args:
            types: NumPy's type letters that will do, ``ui`` or ``buif``.

        Raises:
            BadInput: as :meth:`dataset`; of another type; cannot be read.
        """
        item = self.dataset(name, shape, optional=optional)
        if item is None:
            return None
        if item.dtype.kind not in types:
            raise self.refusal(f"'{name}' is {_type(item)}, expected {TYPES[types]}")
        return self._read(name, item, np.float32 if item.dtype.kind == "f" and item.dtype.itemsize > 4 else None)

    def strings(self, name: str, shape: dict[str, int | None]) -> tuple[str, ...] | None:
        """An optional dataset of strings, stored as text or as bytes.

        Raises:
            BadInput: as :meth:`dataset`; no strings, or not UTF-8.
        """
        item = self.dataset(name, shape, optional=True)
        if item is None:
            return None
        if h5py.check_string_dtype(item.dtype) is None:
            raise self.refusal(f"'{name}' is {_type(item)}, expected strings")
        if item.id.get_type().is_variable_str():
            longest = longest_strings(Path(self.file.filename), item)
            if longest is None:
                raise self.refusal(f"'{name}' is compressed or compact, expected strings that are stored as they are")
            if longest > 4 * LONGEST_STRING:
                raise self.refusal(f"'{name}' holds strings of more than {LONGEST_STRING} characters, expected labels")
        # strings of any length lie anywhere in the file, and many may be one and the same: so many at a time that
        # they fit into memory even if each is as long as the file
        step = max(1, SMALL // max(1, self.file.id.get_filesize()))
        texts: list[str] = []
        for start in range(0, len(item), step):
            try:
                part = item[start : start + step]
                texts += [text.decode() if isinstance(text, bytes) else str(text) for text in part]
            except UnicodeDecodeError as error:
                raise self.refusal(f"'{name}' holds bytes that are not UTF-8, expected strings") from error
            except (OSError, RuntimeError, ValueError) as error:
                raise self.refusal(f"'{name}' cannot be read, the file is damaged or truncated") from error
            if max(len(text) for text in texts[start:]) > LONGEST_STRING:
                raise self.refusal(f"'{name}' holds strings of more than {LONGEST_STRING} characters, expected labels")
        return tuple(texts)

    def attribute(self, name: str) -> Any:
        """A string, a number or None where there is none; one-element arrays (MATLAB's) are taken apart.

        Raises:
            BadInput: neither a string nor one number.
        """
        if name not in self.file.attrs:
            return None
        try:
            stored = self.file.attrs.get_id(name)
            shape = stored.shape or ()
            if stored.get_type().get_size() > SMALL:
                raise self.refusal(f"attribute '{name}' declares {stored.get_type().get_size()} bytes, expected a few")
            if h5py.check_string_dtype(stored.dtype) is not None and stored.get_type().is_variable_str():
                length = longest_string(Path(self.file.filename), name)
                if length > LONGEST_STRING:
                    raise self.refusal(f"attribute '{name}' declares {length} bytes, expected a few")
            if math.prod(shape) > 1:  # not read: it may be of any size
                raise self.refusal(f"attribute '{name}' is an array of shape {shape}, expected a string or one number")
            value = self.file.attrs[name]
            if isinstance(value, np.ndarray) and value.size == 1:
                value = value.reshape(-1)[0]
            if isinstance(value, bytes):
                value = value.decode()
            value = value.item() if isinstance(value, np.generic) else value
        except (OSError, RuntimeError, TypeError, UnicodeDecodeError) as error:
            raise self.refusal(f"attribute '{name}' cannot be read, expected a string or a number") from error
        if not isinstance(value, (str, int, float)):
            raise self.refusal(f"attribute '{name}' is {type(value).__name__}, expected a string or one number")
        return value

    def _read(self, name: str, item: h5py.Dataset, dtype: Any = None) -> Any:
        try:
            return read_dataset(name, item, dtype)
        except BadInput as error:
            raise self.refusal(str(error)) from error


def _type(item: h5py.Dataset) -> str:
    return "strings" if h5py.check_string_dtype(item.dtype) is not None else str(item.dtype)
