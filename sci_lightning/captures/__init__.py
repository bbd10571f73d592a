"""Calibration captures of one camera: reading and writing their file, and packing one from a folder of pictures.

    captures = read_captures("captures.h5")
    dark = captures.take([kind == "dark" for kind in captures.kind])

Only NumPy and h5py are needed; torch is not loaded.
"""

from sci_lightning.captures.captures import Captures
from sci_lightning.captures.kind import KINDS, infer_kind, infer_kinds
from sci_lightning.captures.pack import pack_captures
from sci_lightning.captures.read import read_captures
from sci_lightning.captures.write import write_captures

__all__ = [
    "KINDS",
    "Captures",
    "infer_kind",
    "infer_kinds",
    "pack_captures",
    "read_captures",
    "write_captures",
]
