"""The six grayscale test scenes on which the papers of video SCI report their results, and own ones of that format."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import torch

from sci_lightning.configuration.bounds import ExistingPath, Frames, Size
from sci_lightning.data.source import Clips, Scene
from sci_lightning.data.video_array import read_video_array
from sci_lightning.errors import BadInput, OtherSize
from sci_lightning.files.array_file import ENDINGS

LENGTHS = {"kobe": 32, "traffic": 48, "runner": 8, "drop": 8, "crash": 32, "aerial": 32}
"""Number of frames that papers use, by scene."""

MOST_NAMED = 10
"""Files of a folder that a message names."""
OTHER_NAMES = {"crash": "vehicle"}
"""Names under which a scene is also published."""


class SixScenes:
    """The scenes Kobe, Traffic, Runner, Drop, Crash and Aerial, for testing only.

    A scene is read from a MATLAB file in ``root`` whose name starts with the scene's name (``kobe_cacti.mat``,
    ``runner8_cacti.mat``, ``kobe32_u8_rebuilt.mat``, ...; crash is also called vehicle) and that holds the frames in
    the array ``orig``. Where several files match, files with enough frames are preferred to shorter ones, then the
    original ``*_cacti.mat`` files to others. Any other name is a scene of your own: ``lab01`` is read from the array
    ``orig`` of ``lab01.mat``, ``.npz``, ``.h5`` or ``.hdf5``, or from ``lab01.npy``, all frames of it.

    Args:
        root: the folder that holds the files.
        frames: T, the number of frames in one snapshot; remaining frames at a scene's end are dropped.
        size: ``(H, W)`` in pixels, which must be the size of the files' frames: nothing is resized.
        scenes: the scenes to use, in this order.

    Raises:
        BadInput: a scene has no file, or is shorter than T. :meth:`scenes` opens the files, and raises it
            for one that is unreadable, too short or of another size.
    """

    def __init__(
        self,
        root: ExistingPath,
        frames: Frames,
        size: Size,
        *,
        scenes: Sequence[str] = tuple(LENGTHS),
    ) -> None:
        self.root = Path(root)
        self.frames = frames
        self.size = tuple(size)
        self.names = list(scenes)
        if not self.root.is_dir():
            raise BadInput(f"{root}: no such folder; give the one that holds the six scenes' .mat files")
        if not self.names:
            raise BadInput(f"data.scenes=[]: choose from {self._choices()}")
        short = [name for name in self.names if LENGTHS.get(name, frames) < frames]
        self._refuse(short, f"shorter than a snapshot of {frames} frames")
        missing = [name for name in self.names if not self._files(name)]
        reason = "no file such as {0}_cacti.mat or {0}.mat"
        self._refuse(
            missing,
            reason
            if set(missing) <= set(LENGTHS)
            else f"no file {{0}}.mat, .npz or .h5; choose from {self._choices()}",
        )

    def clips(self) -> Clips:
        """Raise BadInput, because these scenes are for testing only."""
        raise BadInput("the six scenes are for testing only; train on data=davis, folder or synthetic")

    def scenes(self) -> list[Scene]:
        """Return the scenes, float32 ``(N, T, H, W)`` in [0, 1]: the files' values divided by 255."""
        return [Scene(name, self._read(name)) for name in self.names]

    def _read(self, name: str) -> torch.Tensor:
        """Return the frames ``(N, T, H, W)`` of the first file of a scene that is long enough."""
        shorter = []
        for file in self._files(name):
            video = read_video_array(file, "orig", self.size)
            length = LENGTHS.get(name, len(video))
            if len(video) < max(length, self.frames):
                shorter.append(f"{file.name} has {len(video)}")
                continue
            if video.shape[1:] != self.size:
                line = f"{file}: frames of {video.shape[1:]} pixels; the mask's size is {self.size}"
                raise OtherSize(line, video.shape[1:])
            groups = length // self.frames
            video = video[: groups * self.frames].reshape(groups, self.frames, *self.size)
            return torch.from_numpy(video)
        raise BadInput(f"{self.root}: {name} needs {LENGTHS.get(name, self.frames)} frames, but {', '.join(shorter)}")

    def _files(self, name: str) -> list[Path]:
        """Return the files that may hold the scene ``name``, the original ones first."""
        if name not in LENGTHS:
            files = [self.root / f"{name}{ending}" for ending in ENDINGS]
            return [file for file in files if Path(name).name == name and file.is_file()]
        start = re.compile(rf"({name}|{OTHER_NAMES.get(name, name)})(?![a-z])", re.IGNORECASE)
        files = [file for file in self.root.iterdir() if file.suffix.lower() in ENDINGS and start.match(file.name)]
        return sorted(files, key=lambda file: (not file.stem.endswith("_cacti"), file.name))

    def _choices(self) -> str:
        """Name the six scenes, and the files of the folder that may be others."""
        own = sorted({file.stem for file in self.root.iterdir() if file.suffix.lower() in ENDINGS})[:MOST_NAMED]
        return f"{', '.join(LENGTHS)}{' or, of this folder, ' if own else ''}{', '.join(own)}"

    def _refuse(self, names: list[str], reason: str) -> None:
        """Raise BadInput if ``names`` has any scenes, which cannot be used for the given reason."""
        if names:
            rest = [name for name in self.names if name not in names]
            advice = (
                f"; 'data.scenes=[{','.join(rest)}]' leaves {'it' if len(names) == 1 else 'them'} out" if rest else ""
            )
            raise BadInput(f"{self.root}: {', '.join(names)}: {reason.format(names[0])}{advice}")
