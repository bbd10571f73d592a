"""The virtual camera as one object, for the command, for notebooks and for tests of a diagnosis, and one run of it."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sci_lightning.captures.captures import Captures
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.hdf5_file import write_hdf5
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.vocabulary import VOCABULARY
from sci_lightning.virtual_camera.hidden_effects import EffectRequest, choose_effects, log_likelihood_gains
from sci_lightning.virtual_camera.rays.ray_camera import build_camera
from sci_lightning.virtual_camera.session import Acquisition, Session
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


@dataclass(frozen=True)
class VirtualCamera:
    """A simulated camera for video SCI in which effects are hidden, to test a diagnosis with.

    The physics from light to numbers is written in NumPy and shares no code with :mod:`sci_lightning.encoder`, so that
    a mistake in one is not repeated in the other: the overlap of square mirrors with pixels is integrated in closed
    form, photons are Poisson distributed, and the converter rounds and clips. One seed gives the same patterns and
    scenes whatever is hidden.

    Example:
        >>> from sci_lightning.virtual_camera import Session, VirtualCamera
        >>> camera = VirtualCamera(Session(size=(32, 32), frames=4), {"mask_shift": {"dx": 0.61, "dy": -0.35}})
        >>> captures = camera.capture(seed=3)
        >>> captures.measurement.shape, captures.measurement.dtype
        ((30, 32, 32), dtype('uint8'))
        >>> effect, = camera.simulate(seed=3).truth().effects
        >>> effect.name, effect.parameters
        ('mask_shift', {'dx': 0.61, 'dy': -0.35})

    Attributes:
        session: image size, datasheet, and the captures to take.
        effects: what to hide: None, names, ``random``, ``outside``, or ``{name: {parameter: value}}``; see
            :func:`~sci_lightning.virtual_camera.hidden_effects.choose_effects`.
        number: how many effects, for ``random`` and ``outside``.
        magnitude: how strong effects are whose parameters the seed draws: ``clear``, ``weak`` or ``faint``.
    """

    session: Session = field(default_factory=Session)
    effects: EffectRequest = None
    number: int = 1
    magnitude: str = "clear"

    def capture(self, seed: int = 0) -> Captures:
        """Take the captures of the session.

        Args:
            seed: of everything random, 0 or more: patterns, scenes, maps, noise, and parameters that are drawn.

        Returns:
            N captures as ``sci_lightning.captures.read_captures`` returns them, without what is hidden.

        Raises:
            BadInput: effects that cannot be hidden in the session, a mask that cannot be read, or a wrong seed.
        """
        return self.simulate(seed).captures()

    def write(self, path: str | Path, seed: int = 0) -> Path:
        """Take the captures of the session and write them with their truth.

        Args:
            path: the captures file, .h5 or .hdf5.
            seed: see :meth:`capture`.

        Returns:
            The path of ``<name>.truth.json``, which says what is hidden.

        Raises:
            BadInput: as :meth:`capture`, or a path that does not end in .h5 or .hdf5.
        """
        return self.simulate(seed).write(path)

    def simulate(self, seed: int = 0) -> Simulation:
        """Take the captures of the session and return them with everything that is hidden in them.

        Args:
            seed: see :meth:`capture`.

        Raises:
            BadInput: as :meth:`capture`.
        """
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            raise BadInput(f"seed must be a whole number of 0 or more, got {seed!r}")
        hidden = choose_effects(self.effects, self.session, seed, number=self.number, magnitude=self.magnitude)
        acquisition = self.session.acquisition(seed)
        camera = build_camera(self.session, hidden, seed)
        in_order = {effect.name: effect for effect in camera.effects if effect.name in hidden}
        return Simulation(self.session, seed, acquisition, camera.record(acquisition), in_order, camera.fixed_maps)
