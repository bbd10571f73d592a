"""The bench: one set of scenes in front of cameras that share a datasheet and a mask, and differ in their effects."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sci_lightning.captures.captures import Captures
from sci_lightning.data.source import Scene
from sci_lightning.encoder.mask.measured import read_mask
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.studies.mismatch.cameras import Mismatch
from sci_lightning.virtual_camera import Acquisition, Session, VirtualCamera, choose_effects
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.random_numbers import stream
from sci_lightning.virtual_camera.rays.ray_camera import build_camera
from sci_lightning.virtual_camera.scene import binary

LEAST_SIDE = 16
"""Pixels along each side of the smallest field."""


@dataclass(frozen=True, eq=False)
class Bench:
    """Scenes, mask and datasheet; the virtual camera records here, never the encoder.

    Attributes:
        session: the datasheet, and the calibration captures that are taken; ``session.mask`` is the file of the coding
            patterns, which :meth:`write_patterns` writes.
        patterns: the coding patterns (T, H, W) in [0, 1].
        names: of the scenes.
        videos: a video ``(N, T, H, W)`` for every scene, in [0, 1].
        seed: of all noise and of the calibration's scenes.
    """

    session: Session
    patterns: np.ndarray
    names: tuple[str, ...]
    videos: tuple[torch.Tensor, ...]
    seed: int

    @property
    def aperture(self) -> float:
        """Scale of the light of every snapshot."""
        return float(self.session.aperture)

    @property
    def full_scale(self) -> int:
        """The largest DN."""
        return int(2**self.session.bit_depth - 1)

    @cached_property
    def digest(self) -> str:
        """Digest of everything that the measurements depend on besides the camera."""
        settings = asdict(self.session) | {"mask": "", "seed": self.seed, "names": self.names}
        content = hashlib.sha256(json.dumps(settings, sort_keys=True).encode())
        for array in (self.patterns, *(video.numpy() for video in self.videos)):
            content.update(np.ascontiguousarray(array).tobytes())
        return content.hexdigest()[:16]

    def write_patterns(self) -> None:
        """Write the coding patterns to ``session.mask``, where encoders and calibration captures read them."""
        with atomic_write(self.session.mask) as temporary:
            np.save(temporary, self.patterns)

    def effects(self, mismatch: Mismatch) -> dict[str, Effect]:
        """Return the effects of a camera; raises BadInput for a value out of range."""
        return choose_effects(mismatch, self.session, self.seed)

    def record(self, mismatch: Mismatch, *, noise: bool = True) -> np.ndarray:
        """Return the snapshots of all scenes, one after another: raw DN (N, H, W).

        Their noise is independent of that of the calibration captures, and alike for all cameras.

        Args:
            mismatch: effects of the camera; {} for the ideal one.
            noise: whether there is shot noise and read noise; the converter rounds in any case.
        """
        session = self.session
        camera = build_camera(session, self.effects(mismatch), self.seed)
        scene = np.concatenate([video.numpy() for video in self.videos]).astype(np.float32)
        count, slots = scene.shape[:2]
        acquisition = Acquisition(
            patterns=self.patterns,
            sequence=np.tile(np.arange(slots), (count, 1)),
            scene=scene,
            aperture=np.full(count, self.aperture, np.float32),
            exposure=np.ones(count, np.float32),
            kind=("dynamic",) * count,
        )
        random = stream(self.seed, "noise of the snapshots") if noise else None
        return camera.convert(camera.signal(camera.irradiance(acquisition), acquisition, random))

    def snapshots(self, measurement: np.ndarray, most: int) -> Captures:
        """Return snapshots whose scenes nobody knows, as a user has them who has no calibration captures.

        Args:
            measurement: of :meth:`record`.
            most: how many at most; they are spread evenly over the scenes.
        """
        chosen = np.unique(np.linspace(0, len(measurement) - 1, min(most, len(measurement))).round().astype(int))
        count = len(chosen)
        return Captures(
            patterns=self.patterns,
            sequence=np.tile(np.arange(len(self.patterns)), (count, 1)),
            measurement=measurement[chosen],
            scene=np.full((count, *self.patterns.shape), np.nan, np.float32),
            aperture=np.full(count, self.aperture, np.float32),
            exposure=np.ones(count, np.float32),
            kind=("unknown",) * count,
            bit_depth=self.session.bit_depth,
            read_noise_dn=float(self.session.read_noise_dn),
            full_well_e=float(self.session.full_well_e),
            name="snapshots of the mismatch protocol",
            surround="dark",
        )

    def calibration(self, mismatch: Mismatch) -> Captures:
        """Return the calibration captures of a camera, of targets that are not among the scenes."""
        return VirtualCamera(self.session, mismatch).capture(self.seed)


def prepare_bench(
    scenes: Sequence[Scene],
    folder: str | Path,
    *,
    mask: str | Path | None,
    middle: Sequence[int] | None,
    datasheet: Mapping[str, Any],
    calibration: Mapping[str, Any],
    aperture: float | None,
    seed: int,
) -> Bench:
    """Return the bench; nothing is written yet.

    Args:
        scenes: test scenes of one size.
        folder: where the patterns are kept, in a file that is named after what it holds: a training that was made
            behind other patterns does not pass for one behind these.
        mask: file of the coding patterns (T, H, W) in [0, 1]; None draws random binary ones.
        middle: (H, W) of the middle of scenes and mask that is used; None for all.
        datasheet: ``bit_depth``, ``full_well_e`` and ``read_noise_dn`` of the camera.
        calibration: numbers of captures by kind, as :class:`Session` has them.
        aperture: scale of the light; None for 1/T, with which a white scene behind an open mask fills the range, so
            that nothing saturates.
        seed: of everything random.

    Raises:
        BadInput: no scenes, a mask of another size, a middle that is larger than the scenes, or an impossible session.
    """
    if not scenes:
        raise BadInput("the data have no test scenes")
    videos = tuple(torch.stack([scene.video[index] for index in range(len(scene.video))]) for scene in scenes)
    frames, *size = videos[0].shape[1:]
    if mask is None:
        patterns = binary(stream(seed, "patterns"), frames, (size[0], size[1]))
    else:
        patterns = read_mask(mask, setting="").numpy().astype(np.float64)
        if patterns.shape != (frames, *size):
            raise BadInput(
                f"mask={mask}: holds {patterns.shape} (T, H, W), the scenes are {(frames, *size)}; give a mask of "
                f"their size, or frames={len(patterns)} 'size=[{patterns.shape[1]},{patterns.shape[2]}]' and "
                "such scenes"
            )
    if middle is not None:
        if min(middle) < LEAST_SIDE:
            raise BadInput(f"middle={list(middle)}: expected at least {LEAST_SIDE} pixels along each side")
        if any(part > whole for part, whole in zip(middle, size, strict=True)):
            raise BadInput(f"middle={list(middle)}: larger than the scenes, which are {size} (H, W)")
        patterns = _middle(patterns, middle)
        videos = tuple(_middle(video, middle) for video in videos)
    known = set(Session.__dataclass_fields__)
    if unknown := [kind for kind in calibration if kind not in known]:
        raise BadInput(f"calibration: no '{unknown[0]}'; it has dark, flat, all_on, all_off, pattern, static, dynamic")
    patterns = patterns.astype(np.float32)
    content = hashlib.sha256(np.ascontiguousarray(patterns).tobytes()).hexdigest()[:12]
    session = Session(
        size=(int(patterns.shape[1]), int(patterns.shape[2])),
        frames=frames,
        mask=str(Path(folder) / f"patterns_{content}.npy"),
        aperture=1 / frames if aperture is None else aperture,
        surround="dark",
        **datasheet,
        **calibration,
    )
    names = tuple(scene.name for scene in scenes)
    return Bench(session, patterns, names, videos, seed)


def _middle(array: Any, size: Sequence[int]) -> Any:
    """Return the middle (.., h, w) of an array or tensor (.., H, W)."""
    (top, left), (height, width) = (
        tuple((whole - part) // 2 for whole, part in zip(array.shape[-2:], size, strict=True)),
        size,
    )
    return array[..., top : top + height, left : left + width]
