"""Any clip on disk, frame by frame, as 8-bit luma."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from sci_lightning.errors import BadInput

IMAGES = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"})
VIDEOS = frozenset({".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v"})

BT601 = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Full-range BT.601: the weights of red, green and blue in luma."""


def find_clips(root: str | Path) -> list[Path]:
    """Lists the clips below ``root`` in natural order (``clip2`` comes before ``clip10``).

    A clip is a video file, an ``.npz`` file, or a folder that directly holds two or more image files.
    ``root`` may itself be a clip. Names that start with a dot are passed over.

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
            f"{root}: holds no clip; a clip is an .npz file, a video file ({', '.join(sorted(VIDEOS))}) "
            f"or a folder of two or more images ({', '.join(sorted(IMAGES))})"
        )
    return sorted(clips, key=_natural_order)


def frame_files(folder: str | Path) -> list[Path]:
    """The image files directly in ``folder``, in natural order: the frames of one clip."""
    files = [f for f in Path(folder).iterdir() if f.suffix.lower() in IMAGES and not f.name.startswith(".")]
    return sorted(files, key=_natural_order)


def read_clip(path: str | Path) -> np.ndarray:
    """Reads the clip at ``path`` whole: uint8 ``(T, H, W)`` luma; raises as :func:`read_frames` does."""
    return np.stack(list(read_frames(path)))


def read_frames(path: str | Path) -> Iterator[np.ndarray]:
    """Yields the frames of the clip at ``path``, each uint8 ``(H, W)`` luma of one and the same size.

    ``path`` is an ``.npz`` file (its array ``frames``, else its first array of three dimensions or of
    four with the colours last: uint8, or floating point in [0, 1]), a folder of 8-bit images, or a
    video file. Colour becomes luma by full-range BT.601.

    Raises:
        BadInput: no frames, frames of unequal size, values that are not finite or out of range, a file
            that is missing, truncated or otherwise unreadable, or PyAV is not installed.
    """
    path = Path(path)
    if path.is_dir():
        frames = _read_images(path)
    elif path.suffix.lower() == ".npz":
        frames = _read_npz(path)
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
            yield _luma(frame, f"{path}, frame {number}")
    if shape is None:
        raise BadInput(f"{path}: holds no frames")


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Turns whatever a decoder raises for a damaged file into one line that names the file."""
    try:
        yield
    except BadInput:
        raise
    except Exception as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise BadInput(f"{path}: cannot be read ({reason}); is it complete?") from error


def _read_npz(path: Path) -> Iterator[np.ndarray]:
    with np.load(path, allow_pickle=False) as archive:
        names = ["frames"] if "frames" in archive else archive.files
        arrays = (archive[name] for name in names)
        frames = next((a for a in arrays if a.ndim == 3 or (a.ndim == 4 and a.shape[3] == 3)), None)
    if frames is None:
        raise BadInput(f"{path}: its arrays are {names}; expected one of (T, H, W) or (T, H, W, 3)")
    yield from frames


def _read_images(folder: Path) -> Iterator[np.ndarray]:
    from PIL import Image

    for file in frame_files(folder):
        with _naming(file), Image.open(file) as image:
            if image.mode.startswith(("I", "F")):
                raise BadInput(f"{file}: its pixels are of kind {image.mode}; expected 8-bit images")
            image.draft("L", image.size)  # a JPEG holds luma as it is: skip its colours
            frame = np.asarray(image.convert("L"))  # by full-range BT.601 too
        yield frame


def _read_video(path: Path) -> Iterator[np.ndarray]:
    try:
        import av
    except ImportError as error:
        raise BadInput(f"{path}: video files need PyAV; pip install sci-lightning[video]") from error

    with av.open(str(path)) as container:
        if not container.streams.video:
            raise BadInput(f"{path}: holds no video stream")
        container.streams.video[0].thread_type = "AUTO"
        for frame in container.decode(video=0):
            yield frame.to_ndarray(format="rgb24")


def _luma(frame: np.ndarray, where: str) -> np.ndarray:
    """uint8 (H, W) from uint8 or [0, 1] floating point, (H, W) or (H, W, 3)."""
    if np.issubdtype(frame.dtype, np.floating):
        low, high = float(frame.min()), float(frame.max())
        if not (low >= 0 and high <= 1):  # written so that NaN fails too
            raise BadInput(f"{where}: values from {low:g} to {high:g}; floating point must lie in [0, 1]")
        frame = frame * np.float32(255)
    elif frame.dtype != np.uint8:
        raise BadInput(f"{where}: values of type {frame.dtype}; expected uint8, or floats in [0, 1]")
    if frame.ndim == 3:
        frame = frame @ BT601
    return frame if frame.dtype == np.uint8 else np.rint(frame).astype(np.uint8)


def _is_clip_file(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in VIDEOS | {".npz"}


def _natural_order(path: Path) -> tuple[list[str | int], str]:
    parts = re.split(r"([0-9]+)", path.as_posix())
    return [int(p) if i % 2 else p for i, p in enumerate(parts)], path.as_posix()
