"""A camera's encoder.yaml with the files that it names."""

from __future__ import annotations

from pathlib import Path

import numpy as np

TEXT = """
_target_: sci_lightning.encoder.Encoder
aperture: 1.0
mask:
  _target_: sci_lightning.encoder.mask.Measured
  file: patterns.npy
  key: null
  frames: ${frames}
  size: ${size}
sensor: {_target_: sci_lightning.encoder.sensor.ClipQuantise, bit_depth: 8, full_well: null, read_noise: 0.0}
effects:
  mask_shift: {_target_: sci_lightning.encoder.effects.MaskShift, dx: 0.61, dy: -0.35}
  prnu:
    _target_: sci_lightning.encoder.effects.Prnu
    std: 0.02
    file: prnu.npy
    size: ${size}
    seed: 0
  shot_noise: {_target_: sci_lightning.encoder.effects.ShotNoise, full_well: 9000.0}
"""


def encoder_file(folder: Path, size: int = 32, text: str = TEXT) -> Path:
    """An encoder.yaml with what it names beside it."""
    random = np.random.default_rng(0)
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "patterns.npy", random.random((8, size, size)) / 8)
    np.save(folder / "prnu.npy", random.standard_normal((size, size)))
    (folder / "encoder.yaml").write_text(text)
    return folder / "encoder.yaml"
