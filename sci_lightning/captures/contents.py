"""What an open HDF5 file holds, by name, with one clear line where it is not what was expected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from sci_lightning.errors import BadInput

TYPES = {"ui": "integers", "buif": "numbers"}


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
            BadInput: missing, no dataset, kept in another file, other dimensions or lengths.
        """
        letters = f"({', '.join(shape)}{',' if len(shape) == 1 else ''})"
        link = self.file.get(name, getlink=True)
        if link is None:
            if optional:
                return None
            found = ", ".join(self.file) or "nothing"
            raise self.refusal(f"no dataset '{name}' {letters}; the file holds {found}")
        # a file that came by e-mail must not be able to name another file on this machine
        if not isinstance(link, h5py.HardLink):
            raise self.refusal(f"'{name}' is a link, expected a dataset {letters} in the file itself")
        item = self.file[name]
        if not isinstance(item, h5py.Dataset):
            raise self.refusal(f"'{name}' is a group, expected a dataset {letters}")
        if item.is_virtual or item.external:
            raise self.refusal(f"'{name}' is kept in another file, expected a dataset {letters} in the file itself")
        found_shape = item.shape if item.shape is not None else ()
        holds = f"'{name}' is {item.dtype} of shape {found_shape}"
        if len(found_shape) != len(shape):
            raise self.refusal(f"{holds}, expected {len(shape)} dimension{'s' * (len(shape) > 1)} {letters}")
        if 0 in found_shape:
            raise self.refusal(f"{holds}, which is empty; expected {letters} with at least one of each")
        expected = tuple(given or found for given, found in zip(shape.values(), found_shape, strict=True))
        if found_shape != expected:
            raise self.refusal(f"{holds}, expected {letters} = {expected}")
        return item

    def numbers(self, name: str, types: str, shape: dict[str, int | None], *, optional: bool = False) -> Any:
        """A dataset of numbers as an array, None where there is none and it is ``optional``.

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
        return self._read(name, item)

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
        try:
            return tuple(each.decode() if isinstance(each, bytes) else str(each) for each in self._read(name, item))
        except UnicodeDecodeError as error:
            raise self.refusal(f"'{name}' holds bytes that are not UTF-8, expected strings") from error

    def attribute(self, name: str) -> Any:
        """A string, a number or None where there is none; one-element arrays (MATLAB's) are taken apart.

        Raises:
            BadInput: neither a string nor one number.
        """
        if name not in self.file.attrs:
            return None
        try:
            value = self.file.attrs[name]
            if isinstance(value, np.ndarray) and value.size == 1:
                value = value.reshape(-1)[0]
            if isinstance(value, bytes):
                value = value.decode()
            value = value.item() if isinstance(value, np.generic) else value
        except (OSError, TypeError, UnicodeDecodeError) as error:
            raise self.refusal(f"attribute '{name}' cannot be read, expected a string or a number") from error
        if not isinstance(value, (str, int, float)):
            raise self.refusal(f"attribute '{name}' is {type(value).__name__}, expected a string or one number")
        return value

    def _read(self, name: str, item: h5py.Dataset) -> Any:
        try:
            return item[()]
        except MemoryError as error:
            raise self.refusal(f"'{name}' of shape {item.shape} does not fit in memory") from error
        except (OSError, RuntimeError, ValueError) as error:
            raise self.refusal(f"'{name}' cannot be read, the file is damaged or truncated") from error


def _type(item: h5py.Dataset) -> str:
    return "strings" if h5py.check_string_dtype(item.dtype) is not None else str(item.dtype)
