"""The corrected camera for use elsewhere: ``encoder.yaml`` with the arrays that it names, and effective masks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from scipy.io import savemat

from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
from sci_lightning.diagnosis.model.hypothesis import NOISE_GUESS
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.result import Result
from sci_lightning.diagnosis.target_effects import SceneEffect
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import Effect, OpticsEffect
from sci_lightning.encoder.free_form import FreeForm
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.mask import Measured
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.encoder.signal import Signal
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.npy_file import write_npy

MIN_CORRECTED_PROBABILITY = 0.95
"""Smallest probability of an effect in the corrected encoder: a wrong correction costs more than a missing one."""


def write_encoder(result: Result, out: str | Path) -> None:
    """Write the corrected encoder: ``encoder.yaml``, and beside it the patterns and maps that it names.

    It holds every effect whose probability is at least ``MIN_CORRECTED_PROBABILITY``, whatever else has no name. Noise
    that a blind diagnosis has only guessed is left out.
    """
    out, observation, hypothesis = Path(out), result.observation, result.hypothesis
    distinct = torch.tensor([len(set(sequence.tolist())) for sequence in observation.sequences])
    patterns = observation.patterns[observation.sequences[distinct.argmax()]].numpy()
    slots, (height, width) = len(patterns), observation.size
    _save(out / "patterns.npy", patterns)
    effects: dict[str, Any] = {}
    improbable = {
        effect.name
        for effect in result.effects
        if effect.probability is not None and effect.probability < MIN_CORRECTED_PROBABILITY
    }
    for name, values in hypothesis.effects.items():
        effect = result.model.effects[name]
        if name in improbable:
            continue
        if effect.of_captures or issubclass(effect, SceneEffect):
            continue
        if isinstance(result, BlindDiagnosis) and name in NOISE_GUESS and name not in result.stated_noise:
            continue
        effects[name] = {"_target_": f"{effect.__module__}.{effect.__qualname__}", **values}
        if issubclass(effect, FreeForm):
            effects[name]["count"] = effect.count
        if effect.map_kind and name in hypothesis.maps:
            scale = float(values["std"]) if "std" in values else 1.0
            _save(out / f"{name}.npy", (hypothesis.maps[name] / max(scale, 1e-12)).numpy())
            effects[name] |= {"file": f"{name}.npy", "size": [height, width]}
    mask = {"file": "patterns.npy", "key": None, "frames": slots, "size": list(patterns.shape[1:])}
    content: dict[str, Any] = {
        "_target_": "sci_lightning.encoder.Encoder",
        "aperture": "auto",
        "mask": {"_target_": "sci_lightning.encoder.mask.Measured", **mask},
        "sensor": {"_target_": "sci_lightning.encoder.sensor.ClipQuantise", "bit_depth": observation.bit_depth},
        "effects": effects,
    }
    if observation.grid is not None:
        content["sensor_to_modulator"] = observation.grid.sensor_to_modulator.tolist()
        content["size"] = [height, width]
    with atomic_write(out / "encoder.yaml") as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")


def _save(path: Path, array: np.ndarray) -> None:
    with atomic_write(path) as temporary:
        np.save(temporary, array.astype(np.float32))


def encoder_of(observation: Observation, path: LightPath) -> Encoder:
    """Return a camera with the effects of a light path, maps included, behind the sequence of patterns most used.

    Args:
        observation: captures of the camera.
        path: the effects.
    """
    sequence = observation.sequences[observation.sequence.mode().values]
    patterns, grid = observation.patterns[sequence], observation.grid
    mask = Measured(None, len(patterns), (patterns.shape[1], patterns.shape[2]))
    mask.pattern = patterns
    effects = [effect for effect in path.effects.values() if isinstance(effect, Effect)]
    homography = None if grid is None else grid.sensor_to_modulator.tolist()
    sensor = ClipQuantise(observation.bit_depth)
    return Encoder(mask, sensor, effects=effects, sensor_to_modulator=homography, size=observation.size)


@torch.no_grad()
def effective_mask(encoder: Encoder) -> torch.Tensor:
    """Return what multiplies every frame by the time its light is recorded, ``(T, H, W)``, on the sensor's pixels.

    An effect of the optics that cannot be undone on the measurement, a blur, acts on the mask instead: for a scene
    without detail of the mask's size that is the same.
    """
    mask, q = encoder.transmittance(), encoder.path.cells
    ones = mask.new_ones(len(mask), 1, 1)
    signal = Signal(mask, mask.new_zeros(()), ones, encoder.dn, (0, 0), encoder.mask.size, q)
    for effect in encoder.path.of(OpticsEffect):
        if type(effect).undo is OpticsEffect.undo:
            signal = effect.form(signal)
    return signal.pooled().mean


def write_effective_mask(encoder: Encoder, out: str | Path) -> None:
    """Write what multiplies every frame on the sensor's pixels: ``effective_mask.npy`` and ``effective_mask.mat``.

    Both are float32; the first is ``(T, H, W)``, the second holds ``mask`` as MATLAB's ``(H, W, T)``. They serve any
    decoder, of this project or another, that takes a measured mask.

    Args:
        encoder: the corrected camera.
        out: the folder.
    """
    mask = effective_mask(encoder).float().contiguous().numpy()
    with atomic_write(Path(out) / "effective_mask.npy") as temporary:
        write_npy(temporary, mask.shape, iter(mask))
    with atomic_write(Path(out) / "effective_mask.mat") as temporary, temporary.open("wb") as stream:
        savemat(stream, {"mask": mask.transpose(1, 2, 0)}, do_compression=True)
