"""The virtual camera as one object: for the command, for notebooks and for tests of a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from sci_lightning.captures.captures import Captures
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.formulation import build_camera
from sci_lightning.virtual_camera.hidden_effects import EffectRequest, choose_effects
from sci_lightning.virtual_camera.session import Session
from sci_lightning.virtual_camera.simulation import Simulation


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
        magnitude: how strong effects are whose parameters the seed draws: ``clear`` or ``weak``.
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
