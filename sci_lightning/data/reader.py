"""Reading clips from disk, frame by frame, as 8-bit luma or in colour."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.data.video_array import VIDEO_NAMES, read_video_array
from sci_lightning.errors import BadInput
from sci_lightning.files.array_file import array_names
from sci_lightning.files.memory_bound import check_memory
from sci_lightning.files.npy_file import npz_arrays
from sci_lightning.files.picture_file import natural

IMAGES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"})
VIDEOS = frozenset({".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v"})
ARRAYS = frozenset({".mat", ".h5", ".hdf5"})
"""Files that are clips if they hold an array of :data:`~sci_lightning.data.video_array.VIDEO_NAMES`."""

FORMATS = ("PNG", "JPEG", "TIFF", "BMP")
"""Image formats that are read, whatever the names end with: Pillow would hand PostScript to an interpreter."""

CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,avi,matroska,webm"
"""Video containers that are read, whatever the names end with: FFmpeg would follow playlists to other files."""

SLACK = 5
"""Number of frames by which a video may be shorter than its header states: some writers round, or drop frames."""

BT601 = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of red, green and blue in luma, full-range BT.601."""


def find_clips(root: str | Path) -> list[Path]:
    """List the clips below ``root`` in natural order (``clip2`` comes before ``clip10``).

    A clip is a video file, an ``.npz`` file, a MATLAB or HDF5 file with frames, or a folder that directly holds two or
    more image files.
    ``root`` may itself be a clip. Names that start with a dot are ignored.

    Raises:
        BadInput: ``root`` is missing or holds no clip.
    """
    root = Path(root)
    if not root.exists():
        raise BadInput(f"{root}: no such file or folder; give a folder that holds clips")
    clips = [root] if _is_clip_file(root) else []
    for folder, subfolders, names in os.walk(root):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        files = [Path(folder, name) for name in names if not name.startswith(".")]
        clips += [file for file in files if _is_clip_file(file)]
        if sum(file.suffix.lower() in IMAGES for file in files) >= 2:
            clips.append(Path(folder))
    if not clips:
        raise BadInput(
            f"{root}: holds no clip; a clip is an .npz file, a .mat or .h5 file with an array "
            f"{' or '.join(VIDEO_NAMES)}, a video file ({', '.join(sorted(VIDEOS))}) "
            f"or a folder of two or more images ({', '.join(sorted(IMAGES))})"
        )
    return sorted(clips, key=lambda path: natural(path.as_posix()))


def frame_files(folder: str | Path) -> list[Path]:
    """Return the image files directly in ``folder``, the frames of one clip, in natural order."""
    files = [f for f in Path(folder).iterdir() if f.suffix.lower() in IMAGES and not f.name.startswith(".")]
    return sorted(files, key=lambda path: natural(path.as_posix()))


def read_clip(path: str | Path) -> np.ndarray:
    """Return the whole clip at ``path``, uint8 ``(T, H, W)`` luma; raise errors as :func:`read_frames` does."""
    return np.stack(list(read_frames(path)))


def read_frames(path: str | Path, colour: bool = False) -> Iterator[np.ndarray]:
    """Yield the frames of the clip at ``path``, uint8 ``(H, W)`` luma or ``(3, H, W)`` in colour, all of one size.

    ``path`` is a MATLAB or HDF5 file (see :func:`~sci_lightning.data.video_array.read_video_array`), an
    ``.npz`` file (its array ``frames`` or ``orig``, else its first array of three dimensions or of
    four with the colours last: uint8, or floating point in [0, 1]), a folder of 8-bit images, or a
    video file. Colour becomes luma by full-range BT.601.

    Raises:
        BadInput: no frames, in colour gray frames, frames of unequal size, values that are not finite or out of range,
            a file that is missing, truncated or otherwise unreadable, or PyAV is not installed.
    """
    path = Path(path)
    if path.is_dir():
        frames = _read_images(path, colour)
    elif path.suffix.lower() == ".npz":
        frames = _read_npz(path)
    elif path.suffix.lower() in ARRAYS:
        frames = iter(read_video_array(path, VIDEO_NAMES, colour=colour))
    elif path.suffix.lower() in VIDEOS:
        frames = _read_video(path)
    else:
        raise BadInput(f"{path}: not a clip; expected a folder of images, an .npz file or a video file")

    shape = None
    with _naming(path):
        for number, frame in enumerate(frames):
            shape = shape or frame.shape[:2]
            if frame.shape[:2] != shape:
                raise BadInput(
                    f"{path}: frame {number} has {frame.shape[:2]} pixels, the frames before it {shape}; "
                    "all frames of a clip must have one size"
                )
            yield _levels(frame, f"{path}, frame {number}", colour)
    if shape is None:
        raise BadInput(f"{path}: holds no frames")


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Turn any error of a decoder for a damaged file into one line that names the file."""
    try:
        yield
    except BadInput:
        raise
    except Exception as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise BadInput(f"{path}: cannot be read ({reason}); is it complete?") from error


def _read_npz(path: Path) -> Iterator[np.ndarray]:
    arrays = npz_arrays(path)
    name = next((name for name in VIDEO_NAMES if name in arrays), None)
    for array in [arrays[name]] if name else arrays.values():
        if len(array.shape) == 3 or (len(array.shape) == 4 and array.shape[3] == 3):
            if not array.numeric:
                raise BadInput(f"{path}: cannot be read ({array.dtype} of shape {array.shape}); expected numbers")
            try:
                frames = array.read()
            except BadInput as error:
                raise BadInput(f"{path}: {error}") from error
            break
    else:
        names = [name] if name else list(arrays)[:20]
        raise BadInput(f"{path}: its arrays are {names}; expected one of (T, H, W) or (T, H, W, 3)")
    yield from frames


def _read_images(folder: Path, colour: bool) -> Iterator[np.ndarray]:
    from PIL import Image

    for file in frame_files(folder):
        with _naming(file), warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            if not file.is_file():  # a pipe would wait for ever
                raise BadInput(f"{file}: not a file")
            image = Image.open(file, formats=FORMATS)
        with _naming(file), image:
            if image.mode.startswith(("I", "F")):
                raise BadInput(f"{file}: its pixels are of kind {image.mode}; expected 8-bit images")
            if colour and image.mode not in ("1", "L", "LA"):
                frame = np.asarray(image.convert("RGB"))
            else:
                image.draft("L", image.size)  # a JPEG holds luma as it is: skip its colours
                frame = np.asarray(image.convert("L"))  # by full-range BT.601 too
        yield frame


def _read_video(path: Path) -> Iterator[np.ndarray]:
    try:
        import av
    except ImportError as error:
        raise BadInput(f"{path}: video files need PyAV; pip install 'sci-lightning[video]'") from error

    with path.open("rb") as file:  # of AVI, FFmpeg takes what is there for the whole video
        name, stated = file.read(4), int.from_bytes(file.read(4), "little")
    if name == b"RIFF" and path.stat().st_size < 8 + stated < 2**32:
        raise BadInput(f"{path}: is cut off ({path.stat().st_size} of {8 + stated} bytes); copy or download it again")
    count, seconds = 0, 0.0
    with av.open(str(path), options={"format_whitelist": CONTAINERS, "protocol_whitelist": "file"}) as container:
        if not container.streams.video:
            raise BadInput(f"{path}: holds no video stream")
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        check_memory(f"{path}: a frame of {stream.height} x {stream.width} pixels", 3 * stream.height * stream.width)
        for frame in container.decode(stream):
            yield frame.to_ndarray(format="rgb24")
            count += 1
            seconds = max(seconds, frame.time or 0.0)
        length = _duration(stream)
        shown = 1 / float(stream.average_rate or stream.base_rate or 25)
        if length is not None and seconds + SLACK * shown < length:
            many = f" of {stream.frames}" if stream.frames else ""
            raise BadInput(
                f"{path}: is cut off (frames up to {seconds:.2f} s of {length:.2f} s, {count}{many} frames); "
                "copy or download it again"
            )


def _duration(stream: Any) -> float | None:
    """Return the end of a video stream in seconds as its header states it; None if it does not."""
    if stream.duration is not None and stream.time_base is not None:
        return float((stream.duration + (stream.start_time or 0)) * stream.time_base)
    try:
        hours, minutes, seconds = stream.metadata["DURATION"].split(":")  # Matroska
        return 3600 * int(hours) + 60 * int(minutes) + float(seconds)
    except (KeyError, ValueError):
        return None


def _levels(frame: np.ndarray, where: str, colour: bool) -> np.ndarray:
    """Return uint8 (H, W), in colour (3, H, W), from uint8 or floating point in [0, 1], (H, W) or (H, W, 3)."""
    if np.issubdtype(frame.dtype, np.floating):
        low, high = float(frame.min()), float(frame.max())
        if not (low >= 0 and high <= 1):  # written so that NaN fails too
            raise BadInput(f"{where}: values from {low:g} to {high:g}; floating point must lie in [0, 1]")
        frame = frame * np.float32(255)
    elif frame.dtype != np.uint8:
        raise BadInput(f"{where}: values of type {frame.dtype}; expected uint8, or floats in [0, 1]")
    if colour and frame.ndim != 3:
        raise BadInput(f"{where}: is gray, and encoder/sensor=bayer records scenes in colour; give a clip in colour")
    if frame.ndim == 3:
        frame = np.moveaxis(frame, -1, 0) if colour else frame @ BT601
    return frame if frame.dtype == np.uint8 else np.rint(frame).astype(np.uint8)


def _is_clip_file(path: Path) -> bool:
    ending = path.suffix.lower()
    if ending not in ARRAYS or not path.is_file():
        return path.is_file() and ending in VIDEOS | {".npz"}
    try:
        return bool(array_names(path) & set(VIDEO_NAMES))
    except Exception:  # damaged: named when it is read, not passed over
        return True
