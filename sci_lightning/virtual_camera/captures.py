"""Captures with hidden effects, and the file they are written to."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import whole_file
from sci_lightning.files.hdf5_file import write_hdf5
from sci_lightning.virtual_camera.choice import choose
from sci_lightning.virtual_camera.evidence import log_likelihood_gains
from sci_lightning.virtual_camera.hardware.camera import VirtualCamera
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.vocabulary import VOCABULARY
from sci_lightning.virtual_camera.session import Session
from sci_lightning.virtual_camera.shots import Shots


@dataclass(frozen=True)
class Captures:
    """What a session brought home, and what only its maker knows.

    Attributes:
        session: how they were taken.
        seed: of patterns, scenes, maps and noise.
        shots: what was before the camera, unknown scenes included.
        measurement: (N, H, W) raw DN.
        effects: what is hidden, by name.
        charts: the camera's own maps, by effect.
    """

    session: Session
    seed: int
    shots: Shots
    measurement: np.ndarray
    effects: dict[str, Effect]
    charts: dict[str, np.ndarray]

    @property
    def scene(self) -> np.ndarray:
        """(N, T, H, W) float32 as the file tells it: NaN where the scene is unknown."""
        hidden = np.array([kind == "unknown" for kind in self.shots.kind])
        return np.where(hidden[:, None, None, None], np.float32(np.nan), self.shots.scene)

    def truth(self) -> dict[str, Any]:
        """All that is hidden, fit for JSON: effects in the order of light, true noise, and how strongly it shows."""
        gain, gains = log_likelihood_gains(self.session, self.effects, self.seed, self.shots, self.measurement)
        noise = {"full_well_e": self.session.full_well_e, "read_noise_dn": self.session.read_noise_dn}
        for name, effect, parameter in (
            ("full_well_e", "shot_noise", "full_well"),
            ("read_noise_dn", "read_noise", "std"),
        ):
            if effect in self.effects:
                noise[name] = float(self.effects[effect].values[parameter])
        return {
            "format": "sci-captures-truth",
            "format_version": 1,
            "effects": [
                {**self._describe(effect), "log_likelihood_gain": gains[name]} for name, effect in self.effects.items()
            ],
            "noise": noise,
            "log_likelihood_gain": gain,
            "seed": self.seed,
            "session": asdict(self.session),
        }

    def _describe(self, effect: Effect) -> dict[str, Any]:
        about: dict[str, Any] = {
            "name": effect.name,
            "stage": effect.stage,
            "in_vocabulary": effect.name in VOCABULARY,
            "parameters": effect.values,
            "units": {name: each.unit for name, each in effect.parameters().items()},
        }
        if effect.name in self.charts:
            chart = self.charts[effect.name]
            about["map"] = {
                "shape": list(chart.shape),
                **{name: float(getattr(chart, name)()) for name in ("mean", "std", "min", "max")},
                "nonzero": int(np.count_nonzero(chart)),
            }
        return about


def capture_session(session: Session, effects: Any = None, seed: int = 0, **choice: Any) -> Captures:
    """Take a session's captures with a camera in which effects are hidden.

    Args:
        session: what to take, and with which camera.
        effects, choice: see :func:`~sci_lightning.virtual_camera.choice.choose`; {name: {parameter: value}} is one way.
        seed: of everything random, 0 or more. The patterns, scenes and maps of a seed do not depend on the effects.

    Raises:
        BadInput: effects that cannot be hidden in the session.
    """
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise BadInput(f"seed must be a whole number of 0 or more, got {seed!r}")
    hidden = choose(effects, session, seed, **choice)
    shots = session.shots(seed)
    camera = VirtualCamera(session, hidden, seed)
    ordered = {effect.name: effect for effect in camera.effects if effect.name in hidden}
    return Captures(session, seed, shots, camera.record(shots), ordered, camera.charts)


def write_captures(path: str | Path, captures: Captures) -> Path:
    """Write a captures file (HDF5, ``sci-captures`` 1) and beside it ``<name>.truth.json``; returns the latter's path.

    The captures file has nothing of the truth in it. Both are whole or absent.

    Raises:
        BadInput: the name does not end in .h5 or .hdf5, or is a folder's.
    """
    path = Path(path)
    if path.suffix not in (".h5", ".hdf5") or path.is_dir():
        raise BadInput(f"out={path}: a captures file ends in .h5 or .hdf5")
    shots, session = captures.shots, captures.session
    attributes: dict[str, Any] = {
        "format": "sci-captures",
        "format_version": 1,
        "bit_depth": session.bit_depth,
        "name": "virtual camera",
    }
    if session.datasheet:
        attributes |= {"read_noise_dn": session.read_noise_dn, "full_well_e": session.full_well_e}
    datasets: Mapping[str, np.ndarray] = {
        "patterns": shots.patterns,
        "sequence": shots.sequence,
        "measurement": captures.measurement,
        "scene": captures.scene,
        "aperture": shots.aperture,
        "exposure": shots.exposure,
    }
    with whole_file(path) as temporary:
        write_hdf5(temporary, attributes, {**datasets, "kind": shots.kind})
    truth = path.with_suffix(".truth.json")
    with whole_file(truth) as temporary:
        temporary.write_text(json.dumps({**captures.truth(), "captures": path.name}, indent=2) + "\n")
    return truth
