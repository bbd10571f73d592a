"""Snapshots of one camera, and that camera under a hypothesis: an encoder with the commanded patterns as its mask."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.model.camera_model import Setting
from sci_lightning.diagnosis.model.observation import grid_of
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.mask import Measured
from sci_lightning.encoder.modulator_grid import ModulatorGrid
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput


@dataclass(frozen=True)
class SnapshotCamera:
    """Snapshots that one camera took behind the same patterns.

    Attributes:
        measurement: float32 ``(N, H, W)``, normalised by full scale.
        patterns: float32 ``(T, H, W)`` commanded patterns, slot by slot; ``(T, Hm, Wm)`` on a grid of their own.
        bit_depth: of the converter.
        numbers: N numbers of the snapshots in their file.
        verification: ``(N,)`` bool, snapshots that only judge.
        vocabulary: classes of effects by name.
        dark_surround: whether no light comes from beyond the patterns.
        grid: where the mirrors nominally lie; None where every mirror is a pixel.
    """

    measurement: torch.Tensor
    patterns: torch.Tensor
    bit_depth: int
    numbers: tuple[int, ...]
    verification: torch.Tensor
    vocabulary: Mapping[str, type[Effect]]
    dark_surround: bool = False
    grid: ModulatorGrid | None = None

    def __len__(self) -> int:
        return len(self.measurement)

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the field in pixels."""
        return int(self.measurement.shape[1]), int(self.measurement.shape[2])

    @property
    def set_aside(self) -> tuple[int, ...]:
        """Numbers of the snapshots that only judge."""
        return tuple(n for n, aside in zip(self.numbers, self.verification.tolist(), strict=True) if aside)

    def encoder(self, effects: Mapping[str, Setting]) -> Encoder:
        """Return the camera with these effects: values of their parameters by name, by effect."""
        return self.encoder_of(LightPath(self.vocabulary[name](**setting) for name, setting in effects.items()))

    def encoder_of(self, path: LightPath) -> Encoder:
        """Return the camera with the effects of a light path, maps included."""
        mask = Measured(None, len(self.patterns), (self.patterns.shape[1], self.patterns.shape[2]))
        mask.pattern = self.patterns
        homography = None if self.grid is None else self.grid.sensor_to_modulator.tolist()
        return Encoder(
            mask,
            ClipQuantise(self.bit_depth),
            effects=effects_of(path),
            sensor_to_modulator=homography,
            size=self.size,
        )

    def window(self, rows: slice, columns: slice) -> SnapshotCamera:
        """Return a part of the field as a camera of its own: its effects count from the centre of that part."""
        measurement = self.measurement[:, rows, columns]
        if self.grid is None:
            return replace(self, measurement=measurement, patterns=self.patterns[:, rows, columns].contiguous())
        return replace(self, measurement=measurement, grid=self.grid.window(rows, columns))

    def take(self, which: torch.Tensor) -> SnapshotCamera:
        """Return some of the snapshots, ``which`` being ``(N,)`` bool."""
        places = which.nonzero()[:, 0]
        return replace(
            self,
            measurement=self.measurement[places],
            numbers=tuple(self.numbers[place] for place in places.tolist()),
            verification=self.verification[places],
        )


def effects_of(path: LightPath) -> list[Effect]:
    """Return the effects of a light path, in order."""
    return [effect for effect in path.effects.values() if isinstance(effect, Effect)]


def snapshots_of(captures: Captures, vocabulary: Mapping[str, type[Effect]]) -> SnapshotCamera:
    """Return the captures with unknown scenes; of several sequences of patterns, those of the most frequent one.

    Raises:
        BadInput: no such capture, masks that never open, or nothing but black or saturated pixels.
    """
    unknown = np.flatnonzero(~captures.known)
    if not len(unknown):
        raise BadInput(f"{captures.name}: every scene is known; nothing has to be reconstructed")
    sequences = Counter(tuple(captures.sequence[number].tolist()) for number in unknown)
    sequence, _ = sequences.most_common(1)[0]
    numbers = [int(n) for n in unknown if tuple(captures.sequence[n].tolist()) == sequence]
    patterns = torch.from_numpy(captures.patterns[list(sequence)])
    if not patterns.any():
        raise BadInput(f"{captures.name}: the mask never opens: every value is 0; give the mask of these snapshots")
    dn = captures.measurement[numbers]
    for number, image in zip(numbers, dn, strict=True):
        low, high = int(image.min()), int(image.max())
        if low == high or (image == captures.full_scale).mean() > 0.5:
            state = f"{low} DN at every pixel" if low == high else "saturated at more than half of its pixels"
            raise BadInput(f"{captures.name}: snapshot {number} is {state}: leave it out, or change the exposure")
    verification = [captures.verification is not None and number in captures.verification for number in numbers]
    return SnapshotCamera(
        measurement=torch.from_numpy(dn.astype(np.float32)) / captures.full_scale,
        patterns=patterns,
        bit_depth=captures.bit_depth,
        numbers=tuple(numbers),
        verification=torch.tensor(verification),
        vocabulary=vocabulary,
        dark_surround=captures.surround == "dark",
        grid=grid_of(captures),
    )
