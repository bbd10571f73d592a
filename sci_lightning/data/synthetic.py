"""Synthetic video from photographs: those of scikit-image, without any download, or those of a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from sci_lightning.configuration.bounds import ExistingPath, Frames, Repeats, Scenes, Seed, Size
from sci_lightning.data.moving_scene import MovingScene
from sci_lightning.data.photographs import COLOURED, HELD_OUT, TRAINING, Photograph, load_photographs, read_photographs
from sci_lightning.data.source import Clips, Scene
from sci_lightning.errors import BadInput


class Synthetic:
    """Photographs that pan, zoom, turn and occlude each other, rendered on demand.

    Scenes and training clips show different photographs.

    Args:
        frames: T, the number of frames in one snapshot.
        size: ``(H, W)`` in pixels, the mask's full size, in which scenes are rendered.
        crop: ``(h, w)`` in pixels, the size of training clips; None for the full one.
        seed: decides all random choices in the training clips; the scenes are the same for every seed.
        clips_per_epoch: ``len`` of the training clips.
        scenes_count: number of held-out scenes.
        snapshots_per_scene: length of a scene in groups of T frames, in one continuous motion.
        photographs: a file that training clips are made of in place of those of scikit-image, see
            :func:`~sci_lightning.data.photographs.read_photographs`; these clips have motion blur.

    Raises:
        BadInput: an argument is out of range.
    """

    def __init__(
        self,
        frames: Frames,
        size: Size,
        crop: Size | None = None,
        seed: Seed = 0,
        *,
        clips_per_epoch: Repeats = 1000,
        scenes_count: Scenes = 4,
        snapshots_per_scene: Scenes = 2,
        photographs: ExistingPath | None = None,
    ) -> None:
        self.frames = frames
        self.size = size
        self.crop = crop = size if crop is None else crop
        self.seed = seed
        self.clips_per_epoch = clips_per_epoch
        self.scenes_count = scenes_count
        self.snapshots_per_scene = snapshots_per_scene
        self.photographs = photographs
        if min(frames, *size, *crop, clips_per_epoch, scenes_count, snapshots_per_scene) < 1:
            raise BadInput(
                f"frames={frames}, size={tuple(size)}, crop={tuple(crop)}, clips_per_epoch={clips_per_epoch},"
                f" scenes_count={scenes_count}, snapshots_per_scene={snapshots_per_scene}: all must be at"
                " least 1"
            )

    def clips(self) -> Clips:
        """Return an endless stream of rendered clips, float32 ``(T, h, w)`` in [0, 1]."""
        if self.photographs is not None:
            return photographed_clips(self.photographs, self.frames, self.crop, self.seed, self.clips_per_epoch)
        return SyntheticClips(load_photographs(TRAINING), self.frames, self.crop, self.seed, self.clips_per_epoch)

    def scenes(self) -> list[Scene]:
        """Return scenes named after the photograph in their background, float32 ``(N, T, H, W)`` in [0, 1]."""
        photographs = load_photographs(HELD_OUT)
        return [self._scene(number, photographs) for number in range(self.scenes_count)]

    def colour_scenes(self) -> list[Scene]:
        """Return scenes of photographs in colour, float32 ``(N, 3, T, H, W)``: every colour moves in the same way."""
        bands = [load_photographs(COLOURED, band) for band in range(3)]
        alike = ([self._scene(number, photographs) for photographs in bands] for number in range(self.scenes_count))
        return [Scene(one[0].name, torch.stack([torch.as_tensor(scene.video) for scene in one], 1)) for one in alike]

    def _scene(self, number: int, photographs: list[Photograph]) -> Scene:
        again, first = divmod(number, len(photographs))
        name = photographs[first].name + (f"_{again + 1}" if again else "")
        random = np.random.default_rng((0, number))
        scene = MovingScene(photographs[first:] + photographs[:first], random, self.size)
        video = scene.render(self.snapshots_per_scene * self.frames)
        return Scene(name, video.reshape(-1, self.frames, *self.size))


class SyntheticClips(Clips):
    """Training clips of moving photographs; the clip at an index is rendered when it is read."""

    def __init__(
        self,
        photographs: list[Photograph],
        frames: int,
        crop: Sequence[int],
        seed: int,
        clips_per_epoch: int,
        blurred: bool = False,
    ) -> None:
        self.photographs = photographs
        self.frames = frames
        self.crop = crop
        self.seed = seed
        self.clips_per_epoch = clips_per_epoch
        self.blurred = blurred

    def __len__(self) -> int:
        return self.clips_per_epoch

    def __getitem__(self, index: int) -> torch.Tensor:
        if index < 0:
            raise IndexError(f"clip {index}: the stream of clips starts at 0")
        random = np.random.default_rng((self.seed, index))
        photographs = [self.photographs[i] for i in random.permutation(len(self.photographs))]
        return MovingScene(photographs, random, self.crop, self.blurred).render(self.frames)


def photographed_clips(
    path: str | Path, frames: int, crop: Sequence[int], seed: int, clips_per_epoch: int
) -> SyntheticClips:
    """Return clips of the moving photographs of a file, with motion blur.

    Raises:
        BadInput: as :func:`~sci_lightning.data.photographs.read_photographs`.
    """
    return SyntheticClips(read_photographs(path), frames, crop, seed, clips_per_epoch, blurred=True)
