"""One run of the virtual camera: the captures of a session, what is hidden in them, and the files of both."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sci_lightning.captures.captures import Captures
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.hdf5_file import write_hdf5
from sci_lightning.virtual_camera.acquisition import Acquisition
from sci_lightning.virtual_camera.evidence import log_likelihood_gains
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.vocabulary import VOCABULARY
from sci_lightning.virtual_camera.session import Session
from sci_lightning.virtual_camera.truth import HiddenEffect, MapSummary, Noise, Truth

NAME = "virtual camera"
"""Name of the camera in the captures file."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """The captures of one seed, with everything that a captures file does not state.

    Attributes:
        session: how the captures were taken.
        seed: of patterns, scenes, maps and noise.
        acquisition: the camera's input, including the scenes that the file does not state.
        measurement: (N, H, W) raw DN, uint8 up to 8 bits, else uint16.
        effects: the hidden effects by name, in the order in which light meets them.
        fixed_maps: the camera's own maps by the name of their effect.
    """

    session: Session
    seed: int
    acquisition: Acquisition
    measurement: np.ndarray
    effects: dict[str, Effect]
    fixed_maps: dict[str, np.ndarray]

    @property
    def stated_scene(self) -> np.ndarray:
        """(N, T, H, W) float32 scenes as the captures file states them: NaN where the scene is unknown."""
        unknown = np.array([kind == "unknown" for kind in self.acquisition.kind])
        return np.where(unknown[:, None, None, None], np.float32(np.nan), self.acquisition.scene)

    def captures(self) -> Captures:
        """Return the captures as ``read_captures`` would return them from the file: without what is hidden."""
        acquisition, session = self.acquisition, self.session
        return Captures(
            patterns=acquisition.patterns,
            sequence=acquisition.sequence,
            measurement=self.measurement,
            scene=self.stated_scene,
            aperture=acquisition.aperture,
            exposure=acquisition.exposure,
            kind=acquisition.kind,
            bit_depth=session.bit_depth,
            read_noise_dn=self.stated_noise.get("read_noise_dn"),
            full_well_e=self.stated_noise.get("full_well_e"),
            name=NAME,
            surround=self.surround,
        )

    @property
    def stated_noise(self) -> dict[str, float]:
        """The noise that the captures file states; nothing without a datasheet."""
        session = self.session
        noise = {"read_noise_dn": session.read_noise_dn, "full_well_e": session.full_well_e}
        return {name: float(session.datasheet_factor * value) for name, value in noise.items() if session.datasheet}

    @property
    def surround(self) -> str:
        """What the captures file says of the world beyond the patterns."""
        return "dark" if self.session.surround == "dark" else "unknown"

    def truth(self) -> Truth:
        """Return what is hidden, and how strongly the captures speak for it.

        The log-likelihoods take two simulations and one more for every hidden effect.
        """
        gain, gains = log_likelihood_gains(self.session, self.effects, self.seed, self.acquisition, self.measurement)
        effects = tuple(
            HiddenEffect(
                name=name,
                stage=effect.stage,
                in_vocabulary=name in VOCABULARY,
                parameters=effect.values,
                units={parameter: known.unit for parameter, known in effect.parameters().items()},
                **({"map": MapSummary.of_map(self.fixed_maps[name])} if name in self.fixed_maps else {}),
                log_likelihood_gain=gains[name],
            )
            for name, effect in self.effects.items()
        )
        noise = Noise(
            full_well_e=self._true_value("shot_noise", "full_well", self.session.full_well_e),
            read_noise_dn=self._true_value("read_noise", "std", self.session.read_noise_dn),
        )
        return Truth(
            effects=effects,
            noise=noise,
            log_likelihood_gain=gain,
            seed=self.seed,
            session=self.session,
            also_true=self.session.also_true,
        )

    def write(self, path: str | Path) -> Path:
        """Write the captures file (HDF5, ``sci-captures`` 2) and ``<name>.truth.json`` beside it.

        The captures file contains nothing of the truth. Each file is written whole or not at all. The writer of
        :mod:`sci_lightning.captures` is deliberately not used, so that the reader is tested with files of a second one.

        Args:
            path: ends in .h5 or .hdf5.

        Returns:
            The path of the truth file.

        Raises:
            BadInput: another ending, or the path of a folder.
        """
        path = Path(path)
        if path.suffix not in (".h5", ".hdf5") or path.is_dir():
            raise BadInput(f"out={path}: a captures file ends in .h5 or .hdf5")
        acquisition, session = self.acquisition, self.session
        attributes: dict[str, str | int | float] = {
            "format": "sci-captures",
            "format_version": 2,
            "bit_depth": session.bit_depth,
            "name": NAME,
            "surround": self.surround,
        }
        attributes |= self.stated_noise
        datasets = {
            "patterns": acquisition.patterns,
            "sequence": acquisition.sequence,
            "measurement": self.measurement,
            "scene": self.stated_scene,
            "aperture": acquisition.aperture,
            "exposure": acquisition.exposure,
            "kind": acquisition.kind,
        }
        with atomic_write(path) as temporary:
            write_hdf5(temporary, attributes, datasets)
        truth = path.with_suffix(".truth.json")
        with atomic_write(truth) as temporary:
            temporary.write_text(json.dumps({**self.truth().as_json(), "captures": path.name}, indent=2) + "\n")
        return truth

    def _true_value(self, effect: str, parameter: str, datasheet: float) -> float:
        """Return the value of a noise parameter: the hidden one, or the datasheet's where none is hidden."""
        return float(self.effects[effect].values[parameter]) if effect in self.effects else datasheet
