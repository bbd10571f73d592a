"""Grey pictures out of TIFF, PNG, BMP, PGM, JPEG, raw, NPY, NPZ, MAT and HDF5 files, with the numbers as stored."""

from __future__ import annotations

import glob
import re
import warnings
from collections import defaultdict
from pathlib import Path

import numpy as np

from sci_lightning.errors import BadInput, InputWarning
from sci_lightning.files.array_file import ENDINGS, read_array, time_first
from sci_lightning.files.memory_bound import check_memory
from sci_lightning.files.packed_file import RawLayout, read_raw
from sci_lightning.files.tiff_file import grey_of_colours, read_tiff

PICTURES = (".png", ".tif", ".tiff", ".bmp", ".pgm", ".jpg", ".jpeg")
"""In the order in which one kind is chosen where a folder holds the same pictures in several."""
COPIES = 3
"""Copies of a stack that are in memory at once while it is checked and joined with others."""


def read_pictures(
    path: str | Path, *, prefer: str, key: str | None = None, setting: str = "", raw: RawLayout | None = None
) -> np.ndarray:
    """Read ``(H, W)``, or ``(N, H, W)`` of a TIFF stack, a raw file or a file of arrays (``(H, W, N)`` in a MAT file).

    Args:
        path: one of :data:`PICTURES` or of :data:`~sci_lightning.files.array_file.ENDINGS`; any other with ``raw``.
        prefer, key, setting: name of the array, see :func:`~sci_lightning.files.array_file.read_array`.
        raw: what a file of raw numbers does not say of itself.

    Returns:
        Numbers of the type that the file has, black as 0.

    Raises:
        BadInput: missing or unreadable file, unknown ending, colour, complex numbers, a compression for which no reader
            is installed, no such array, more than the file holds or than the bounds of memory_bound.py allow.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending in ENDINGS and raw is None:
        array = read_array(path, key=key, prefer=prefer, dimensions=(3, 2), setting=setting)
        return time_first(path, array) if array.ndim == 3 else array
    if path.is_dir():
        raise BadInput(f"{path}: is a folder, expected a file")
    if ending not in PICTURES and raw is None:
        raise BadInput(
            f"{path}: cannot read a picture from '{ending}'; use one of {', '.join(PICTURES + ENDINGS)}, or say what a "
            "raw file holds: raw_format=Mono12p 'raw_size=[H,W]'"
        )
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    try:
        if raw is not None:
            picture = read_raw(path, raw)
        elif ending in (".tif", ".tiff"):
            picture = read_tiff(path)
        elif ending == ".pgm":
            picture = _pgm(path.read_bytes())
        else:
            picture = _by_pillow(path)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from error
    except Exception as error:  # every format has errors of its own
        reason = " ".join(str(error).split())[:200]
        reason = f"{type(error).__name__}: {reason}" if reason else type(error).__name__
        raise BadInput(f"{path}: not a readable picture, damaged or truncated ({reason})") from error
    if picture.ndim not in (2, 3) or picture.size == 0:
        raise BadInput(f"{path}: one grey channel is expected, this picture is {picture.shape}")
    if picture.dtype.kind not in "buif":
        raise BadInput(f"{path}: real numbers are expected, this picture holds {picture.dtype}")
    return picture


def read_stack(paths: list[str], *, prefer: str) -> list[np.ndarray]:
    """Return the pictures ``(K, H, W)`` of every file, all of one size.

    Raises:
        BadInput: as :func:`read_pictures`; or pictures of several sizes, or more than memory allows.
    """
    stacks: list[np.ndarray] = []
    for path in paths:
        array = read_pictures(path, prefer=prefer)
        taken = sum(stack.nbytes for stack in stacks) + array.nbytes
        check_memory(f"{path} with those before it", COPIES * taken)
        stacks.append(array if array.ndim == 3 else array[None])
        if stacks[-1].shape[1:] != stacks[0].shape[1:]:
            raise BadInput(f"{path} is {array.shape[-2:]} (H, W), the first is {stacks[0].shape[1:]}")
    return stacks


def matching_files(name: str | Path) -> list[str]:
    """Return the file of this name, or the files that a pattern such as ``scene*.mat`` fits, in natural order.

    Raises:
        BadInput: no file fits.
    """
    if Path(name).is_dir():
        raise BadInput(f"{name}: is a folder, expected a file; several are given as '{name}/*.tiff'")
    if Path(name).is_file():
        return [str(name)]
    folder = Path(name).parent  # brackets are legal in its name
    place = str(Path(glob.escape(str(folder)), Path(name).name)) if folder.is_dir() else str(name)
    files = [path for path in glob.glob(place) if Path(path).is_file()]
    if not files:
        raise BadInput(f"{name}: no such file")
    return sorted(files, key=natural)


def pictures_of(folder: str | Path) -> list[str]:
    """Return the pictures that lie directly in a folder, in natural order.

    Where it holds the same names in several formats, those of the first of :data:`PICTURES` are taken, with a warning.

    Raises:
        BadInput: no picture, or pictures of several formats with different names.
    """
    formats: dict[str, list[str]] = defaultdict(list)
    for file in Path(folder).iterdir():
        if file.suffix.lower() in PICTURES and not file.name.startswith(".") and file.is_file():
            formats[file.suffix.lower()].append(str(file))
    if not formats:
        raise BadInput(f"{folder}: holds no picture; expected the patterns as {', '.join(PICTURES)}, or a file")
    names = {ending: {Path(file).stem for file in files} for ending, files in formats.items()}
    chosen = min(formats, key=PICTURES.index)
    if any(stems != names[chosen] for stems in names.values()):
        counts = ", ".join(f"{len(files)} {ending}" for ending, files in formats.items())
        raise BadInput(f"{folder}: holds {counts} of different names; say which: '{folder}/*{chosen}'")
    if len(formats) > 1:
        also = ", ".join(ending for ending in formats if ending != chosen)
        line = f"{folder}: holds the same {len(names[chosen])} names as {chosen} and {also}; those of {chosen} are read"
        warnings.warn(line, InputWarning, stacklevel=2)
    return sorted(formats[chosen], key=natural)


def natural(path: str) -> list[tuple[int, str]]:
    """Return a key by which frame2 comes before frame10."""
    return [(int(digits or -1), text) for digits, text in re.findall(r"(\d+)|(\D+)", path)]


def _pgm(data: bytes) -> np.ndarray:
    """Read a binary PGM, whose numbers Pillow would scale to 8 or 16 bits."""
    rest = rb"\s+(?:#[^\n]*\n\s*)*"
    header = re.match(b"P5" + rest + rb"(\d+)" + rest + rb"(\d+)" + rest + rb"(\d+)\s", data[:1000])
    if header is None:
        raise BadInput("not a binary PGM (P5) of grey levels")
    width, height, largest = map(int, header.groups())
    picture = np.frombuffer(data, ">u2" if largest > 255 else "u1", width * height, header.end())
    return picture.reshape(height, width).astype(np.uint16 if largest > 255 else np.uint8)


def _by_pillow(path: Path) -> np.ndarray:
    """Read a PNG, BMP or JPEG, grey or of equal colours; a PNG of any depth with the numbers that it has."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        image = Image.open(path, formats=["PNG", "BMP", "JPEG"])
    with image:
        with path.open("rb") as stream:
            bits = stream.read(25)[24] if image.format == "PNG" else 8  # of the header, which comes first
        if image.format == "JPEG":
            line = f"{path}: JPEG does not keep the camera's numbers; save PNG or TIFF without loss"
            warnings.warn(line, InputWarning, stacklevel=2)
        if image.mode in ("P", "PA"):
            return grey_of_colours(np.asarray(image.convert("RGBA")), image.mode)
        if image.mode not in ("1", "L", "I;16", "I;16B", "I") and bits == 16:
            raise BadInput(f"one grey channel is expected, this picture is {image.mode} of 16 bits")
        picture = np.asarray(image)
        if picture.ndim == 3:
            return grey_of_colours(picture, image.mode)
    if bits in (2, 4):  # Pillow spreads these over the range of 8 bits
        return picture // (255 // (2**bits - 1))
    return picture.astype(np.uint16) if bits == 16 else picture
