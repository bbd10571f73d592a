"""The six grayscale scenes that video SCI papers report."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import torch

from sci_lightning.configuration.bounds import Frames, Size
from sci_lightning.data.matlab import read_matlab_video
from sci_lightning.data.source import Clips, Scene
from sci_lightning.errors import BadInput, OtherSize

LENGTHS = {"kobe": 32, "traffic": 48, "runner": 8, "drop": 8, "crash": 32, "aerial": 32}
"""How many frames of each scene papers use."""

OTHER_NAMES = {"crash": "vehicle"}


class Benchmark:
    """Kobe, Traffic, Runner, Drop, Crash and Aerial, for testing only.

    A scene is a MATLAB file in ``root`` whose name starts with the scene's (``kobe_cacti.mat``,
    ``runner8_cacti.mat``, ``kobe32_u8_rebuilt.mat``, ...; crash is also called vehicle) and that holds
    the frames under ``orig``. Of several, those with enough frames come before shorter ones, then the
    original ``*_cacti.mat`` before others.

    Args:
        root: the folder that holds the files.
        frames: T, the frames of one snapshot; what is left over at a scene's end is dropped.
        size: ``(H, W)`` in pixels, which must be that of the files: nothing is resized.
        scenes: the scenes to use, in this order.

    Raises:
        BadInput: a scene is unknown, has no file, or is shorter than T. Files are opened by ``scenes``,
            which raises it for one unreadable, too short or of another size.
    """

    def __init__(
        self,
        root: str | Path,
        frames: Frames,
        size: Size,
        *,
        scenes: Sequence[str] = tuple(LENGTHS),
    ) -> None:
        self.root = Path(root)
        self.frames = frames
        self.size = tuple(size)
        self.names = list(scenes)
        if not self.names or not set(self.names) <= set(LENGTHS):
            raise BadInput(f"data.scenes={self.names}: choose from {', '.join(LENGTHS)}")
        if not self.root.is_dir():
            raise BadInput(f"{root}: no such folder; give the one that holds the benchmark's .mat files")
        short = [name for name in self.names if LENGTHS[name] < frames]
        self._refuse(short, f"shorter than a snapshot of {frames} frames")
        missing = [name for name in self.names if not self._files(name)]
        self._refuse(missing, "no file such as {0}_cacti.mat or {0}.mat")

    def clips(self) -> Clips:
        """Raises BadInput: these scenes are for testing."""
        raise BadInput("the benchmark scenes are for testing only; train on data=davis, folder or synthetic")

    def scenes(self) -> list[Scene]:
        """The scenes, float32 ``(N, T, H, W)``: the files' values divided by 255."""
        return [Scene(name, self._read(name)) for name in self.names]

    def _read(self, name: str) -> torch.Tensor:
        """(N, T, H, W): the frames of the best file that has enough."""
        length = LENGTHS[name]
        shorter = []
        for file in self._files(name):
            video = read_matlab_video(file, "orig")
            if len(video) < length:
                shorter.append(f"{file.name} has {len(video)}")
                continue
            if video.shape[1:] != self.size:
                line = f"{file}: frames of {video.shape[1:]} pixels; the mask's size is {self.size}"
                raise OtherSize(line, video.shape[1:])
            groups = length // self.frames
            video = video[: groups * self.frames].reshape(groups, self.frames, *self.size)
            return torch.from_numpy(video)
        raise BadInput(f"{self.root}: {name} needs {length} frames, but {', '.join(shorter)}")

    def _files(self, name: str) -> list[Path]:
        """The files that may hold the scene ``name``, the original ones first."""
        start = re.compile(rf"({name}|{OTHER_NAMES.get(name, name)})(?![a-z])", re.IGNORECASE)
        files = [file for file in self.root.glob("*.mat") if start.match(file.name)]
        return sorted(files, key=lambda file: (not file.stem.endswith("_cacti"), file.name))

    def _refuse(self, names: list[str], reason: str) -> None:
        if names:
            rest = [name for name in self.names if name not in names]
            advice = (
                f"; data.scenes=[{','.join(rest)}] leaves {'it' if len(names) == 1 else 'them'} out" if rest else ""
            )
            raise BadInput(f"{self.root}: {', '.join(names)}: {reason.format(names[0])}{advice}")
