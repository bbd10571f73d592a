"""The base class of everything that can be hidden in the virtual camera, and its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, TypeVar

import numpy as np

from sci_lightning.errors import BadInput

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Acquisition, Session

Value: TypeAlias = float | int | str
Maps: TypeAlias = Mapping[str, np.ndarray]
"""A camera's own maps by the name of their effect."""


@dataclass(frozen=True)
class Parameter:
    """Unit, range and random distribution of a parameter.

    Attributes:
        unit: such as ``pixel``; ``1`` for a ratio, empty for a word.
        low, high: smallest and largest possible value.
        drawn: range of random values. For a ``magnitude`` it holds distances from the neutral value, log-uniformly
            distributed; for anything else the values themselves, uniformly distributed.
        signed: whether a magnitude may be drawn on either side of its neutral value.
        magnitude: whether the parameter scales how strong the effect is. Weak effects have their magnitudes reduced and
            their other parameters unchanged.
        integer: whether only whole numbers are possible.
        choices: the possible words, for a parameter that is not a number.
    """

    unit: str
    low: float = -math.inf
    high: float = math.inf
    drawn: tuple[float, float] = (0.0, 0.0)
    signed: bool = False
    magnitude: bool = True
    integer: bool = False
    choices: tuple[str, ...] = ()

    def draw(self, random: np.random.Generator, neutral: Value) -> Value:
        """Return a random value that is clearly away from ``neutral``, where the effect does nothing."""
        if self.choices:
            return str(random.choice([word for word in self.choices if word != neutral]))
        if self.integer:
            return int(random.integers(int(self.drawn[0]), int(self.drawn[1]), endpoint=True))
        if not self.magnitude:
            return float(random.uniform(*self.drawn))
        distance = math.exp(random.uniform(math.log(self.drawn[0]), math.log(self.drawn[1])))
        upwards = random.random() < 0.5 if self.signed else float(neutral) < self.high
        return float(neutral) + (distance if upwards else -distance)

    def checked(self, where: str, value: object) -> Value:
        """Return ``value`` as this parameter's type.

        Args:
            where: names the parameter in the message, such as ``gain.factor``.
            value: anything that a user gave.

        Raises:
            BadInput: a value of another type or out of range.
        """
        if self.choices:
            if value not in self.choices:
                raise BadInput(f"{where} must be one of {', '.join(self.choices)}; got {value!r}")
            return str(value)
        if (
            not isinstance(value, (int, float))
            or isinstance(value, bool)
            or not self.low <= value <= self.high
            or (self.integer and value != int(value))
        ):
            kind = "a whole number" if self.integer else "a number"
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise BadInput(f"{where} must be {kind} from {self.low:g} to {self.high:g}{unit}, got {value!r}")
        return int(value) if self.integer else float(value)


def parameter(
    unit: str,
    low: float,
    high: float,
    drawn: Sequence[float] = (0.0, 0.0),
    *,
    neutral: Any = MISSING,
    signed: bool = False,
    magnitude: bool = True,
    integer: bool = False,
) -> Any:
    """Return a dataclass field described by a :class:`Parameter`; its default is the neutral value, if there is one."""
    description = Parameter(unit, low, high, (drawn[0], drawn[1]), signed, magnitude, integer)
    return field(default=neutral, metadata={"parameter": description})


def choice(*words: str, neutral: str) -> Any:
    """Return a dataclass field whose value is one of ``words``."""
    return field(default=neutral, metadata={"parameter": Parameter("", choices=words, magnitude=False)})


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
