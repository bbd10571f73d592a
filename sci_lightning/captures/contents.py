"""Typed access to the datasets and attributes of an open HDF5 file; anything unexpected is refused in one line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import h5py
import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.hdf5_file import check_dataset, own_dataset, read_dataset
from sci_lightning.files.hdf5_heap import longest_string, longest_strings
from sci_lightning.files.memory_bound import SMALL

Shape: TypeAlias = Mapping[str, int | None]
"""The length of every axis by its letter, in order; None stands for any length but 0."""

TYPES = {"ui": "integers", "buif": "numbers"}
LONGEST_STRING = 1000
"""Largest number of characters of a label."""


@dataclass(frozen=True)
class Contents:
    """An open file.

    Attributes:
        file: the file.
        called: its name in messages.
    """

    file: h5py.File
    called: str

    def refusal(self, text: str) -> BadInput:
        """Return the error that says ``text`` about this file."""
        return BadInput(f"{self.called}: {' '.join(text.split())}")

    def required_dataset(self, name: str, shape: Shape) -> h5py.Dataset:
        """Return a dataset that has to be there; see :meth:`dataset`."""
        item = self.dataset(name, shape)
        if item is None:
            names = ", ".join(list(self.file)[:20]) or "nothing"
            raise self.refusal(f"no dataset '{name}' {_letters(shape)}; the file holds {names}")
        return item

    def dataset(self, name: str, shape: Shape) -> h5py.Dataset | None:
        """Return a dataset that is stored in this very file, None if there is none.

        Args:
            name: of the dataset.
            shape: the length of every axis by its letter, in order, such as ``{"N": 34, "T": None}``; None stands for
                any length but 0.

        Raises:
            BadInput: not a dataset, other dimensions or lengths, or what
                :func:`~sci_lightning.files.hdf5_file.check_dataset` refuses: kept in another file, too large, ...
        """
        letters = _letters(shape)
        try:
            item = own_dataset(self.file, name, f"a dataset {letters}")
        except BadInput as error:
            raise self.refusal(str(error)) from error
        if item is None:
            return None
        stored_shape = item.shape if item.shape is not None else ()
        holds = f"'{name}' is {item.dtype} of shape {stored_shape}"
        if len(stored_shape) != len(shape):
            raise self.refusal(f"{holds}, expected {len(shape)} dimension{'s' * (len(shape) > 1)} {letters}")
        if 0 in stored_shape:
            raise self.refusal(f"{holds}, which is empty; expected {letters} with at least one of each")
        expected = tuple(length or stored for length, stored in zip(shape.values(), stored_shape, strict=True))
        if stored_shape != expected:
            raise self.refusal(f"{holds}, expected {letters} = {expected}")
        try:
            check_dataset(name, item)
        except BadInput as error:
            raise self.refusal(str(error)) from error
        return item

    def required_numbers(self, name: str, types: str, shape: Shape) -> np.ndarray:
        """Return a dataset of numbers that has to be there; see :meth:`numbers`."""
        return self._read_numbers(name, types, self.required_dataset(name, shape))

    def numbers(self, name: str, types: str, shape: Shape) -> np.ndarray | None:
        """Return a dataset of numbers as an array, None if there is none.

        Numbers of double precision are converted to single precision while they are read.

        Args:
            name: of the dataset.
            types: the permitted type letters of NumPy, ``ui`` or ``buif``.
            shape: see :meth:`dataset`.

        Raises:
            BadInput: as :meth:`dataset`; another type, or a dataset that cannot be read.
        """
        item = self.dataset(name, shape)
        return None if item is None else self._read_numbers(name, types, item)

    def _read_numbers(self, name: str, types: str, item: h5py.Dataset) -> np.ndarray:
        if item.dtype.kind not in types:
            raise self.refusal(f"'{name}' is {_type(item)}, expected {TYPES[types]}")
        double = item.dtype.kind == "f" and item.dtype.itemsize > 4
        try:
            return np.asarray(read_dataset(name, item, np.float32 if double else None))
        except BadInput as error:
            raise self.refusal(str(error)) from error

    def strings(self, name: str, shape: Shape) -> tuple[str, ...] | None:
        """Return a dataset of strings, stored as text or as bytes; None if there is none.

        Raises:
            BadInput: as :meth:`dataset`; not strings, or not UTF-8.
        """
        item = self.dataset(name, shape)
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
        # Several entries may refer to the same string, of any length. Read only so many at a time that they fit into
        # memory even if every one of them is as long as the file.
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

    def attribute(self, name: str) -> str | int | float | None:
        """Return an attribute that is a string or a number, None if there is none.

        An array with one element, as MATLAB writes them, counts as its element.

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

    def matrix(self, name: str, shape: tuple[int, int]) -> np.ndarray | None:
        """Return an attribute that is a float64 matrix of this shape, None if there is none.

        Raises:
            BadInput: something else.
        """
        if name not in self.file.attrs:
            return None
        expected = f"{shape[0]} x {shape[1]} numbers"
        try:
            stored = self.file.attrs.get_id(name)
            if stored.shape != shape or stored.dtype.kind not in "uif":
                raise self.refusal(f"attribute '{name}' is {stored.dtype} of shape {stored.shape}, expected {expected}")
            return np.array(self.file.attrs[name], np.float64)
        except (OSError, RuntimeError, TypeError) as error:
            raise self.refusal(f"attribute '{name}' cannot be read, expected {expected}") from error

    def indices(self, name: str, count: int) -> tuple[int, ...] | None:
        """Return an attribute that lists different whole numbers below ``count``; None if there is none.

        Raises:
            BadInput: something else, more than ``count`` numbers, a number twice or out of range.
        """
        if name not in self.file.attrs:
            return None
        expected = f"a list of different whole numbers from 0 to {count - 1}"
        try:
            stored = self.file.attrs.get_id(name)
            shape = stored.shape
            fits = shape is not None and len(shape) <= 1 and math.prod(shape) <= count and stored.dtype.kind in "ui"
            values = np.atleast_1d(self.file.attrs[name]).tolist() if fits else None
        except (OSError, RuntimeError, TypeError) as error:
            raise self.refusal(f"attribute '{name}' cannot be read, expected {expected}") from error
        if values is None:
            empty = shape is None or 0 in shape
            if empty:
                return ()
            raise self.refusal(f"attribute '{name}' is {stored.dtype} of shape {shape}, expected {expected}")
        wrong = [value for value in values if not 0 <= value < count]
        if wrong or len(set(values)) < len(values):
            holds = f"holds {wrong[0]}" if wrong else "holds a number twice"
            raise self.refusal(f"attribute '{name}' {holds}, expected {expected}")
        return tuple(int(value) for value in values)


def _letters(shape: Shape) -> str:
    """Return the axes as messages name them, such as ``(N, T)``."""
    return f"({', '.join(shape)}{',' if len(shape) == 1 else ''})"


def _type(item: h5py.Dataset) -> str:
    return "strings" if h5py.check_string_dtype(item.dtype) is not None else str(item.dtype)
