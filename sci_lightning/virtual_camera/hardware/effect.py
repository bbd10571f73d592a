"""The base class of everything that can be hidden in the virtual camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, ClassVar, TypeVar

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.parameter import Parameter, Value

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.acquisition import Acquisition
    from sci_lightning.virtual_camera.session import Session

E = TypeVar("E", bound="Effect")


@dataclass(frozen=True)
class Effect:
    """A physical deviation from the ideal camera. The dataclass fields of a subclass are its parameters.

    Each stage of the camera has a base class of its own with the method that changes the light there; see
    :class:`.modulator.ModulatorEffect`, :class:`.relay.RelayEffect`, :class:`.exposure.ExposureEffect`,
    :class:`.optics.OpticsEffect` and :class:`.sensor.SensorEffect`.

    Attributes:
        name: the effect's name in truth files and on the command line.
        stage: where it acts on the light: ``capture``, ``scene``, ``modulator``, ``relay``, ``exposure``,
            ``optics`` or ``sensor``.
        gaussian_map: whether it has a fixed-pattern map of independent Gaussian values, which a diagnosis has to
            estimate from the captures.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    gaussian_map: ClassVar[bool] = False

    @classmethod
    def parameters(cls) -> dict[str, Parameter]:
        """Return the description of every parameter by its name."""
        return {field.name: field.metadata["parameter"] for field in fields(cls)}

    @property
    def values(self) -> dict[str, Value]:
        """The value of every parameter by its name."""
        return {name: getattr(self, name) for name in self.parameters()}

    @classmethod
    def from_values(cls: type[E], values: Mapping[str, object], session: Session) -> E:
        """Return the effect with the given parameter values; a parameter that is not given keeps its neutral value.

        Raises:
            BadInput: an unknown parameter, a value out of range, or one that does not suit the session.
        """
        parameters = cls.parameters()
        unknown = [name for name in values if name not in parameters]
        if unknown:
            raise BadInput(f"effect {cls.name} has no parameter '{unknown[0]}'; it has {', '.join(parameters)}")
        checked = {name: parameters[name].checked(f"{cls.name}.{name}", value) for name, value in values.items()}
        effect = replace(cls.neutral(session), **checked)
        effect.check(session)
        return effect

    @classmethod
    def neutral(cls: type[E], session: Session) -> E:
        """Return the effect with the parameters that leave the session's camera as it is."""
        return cls()

    @classmethod
    def draw(cls: type[E], random: np.random.Generator, session: Session) -> E:
        """Return the effect with random parameters, strong enough to be clearly visible in a full session."""
        neutral = cls.neutral(session)
        drawn = {name: parameter.draw(random, getattr(neutral, name)) for name, parameter in cls.parameters().items()}
        return replace(neutral, **drawn)

    @classmethod
    def is_visible_in(cls, session: Session) -> bool:
        """Return whether the effect can show in the session's captures at all, and so may be drawn for it."""
        return True

    def check(self, session: Session) -> None:
        """Raise BadInput if the parameters do not fit the session's image size, number of slots or bit depth."""

    def weakened(self: E, share: float, session: Session) -> E:
        """Return the effect with every magnitude reduced to ``share`` of its distance from the neutral value."""
        neutral = self.neutral(session)
        names = [name for name, known in self.parameters().items() if known.magnitude and not known.integer]
        start = {name: getattr(neutral, name) for name in names}
        return replace(self, **{name: start[name] + share * (getattr(self, name) - start[name]) for name in names})

    def draw_map(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray | None:
        """Return this camera's own map for the effect (its per-pixel gains, its dust), None if it has none.

        Args:
            random: source of the map's values.
            size: (H, W) of the field in pixels; the map broadcasts to it.
        """
        return None

    @property
    def captures(self) -> tuple[int, ...]:
        """Indices of the captures that alone are changed; none where it is all of them."""
        return ()

    def happened(self, acquisition: Acquisition) -> Acquisition:
        """Return what really took place when an acquisition was planned; usually just that."""
        return acquisition
