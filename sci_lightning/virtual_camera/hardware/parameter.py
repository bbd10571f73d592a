"""A parameter of an effect: which values are possible, and how one is drawn at random."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field
from typing import Any, TypeAlias

import numpy as np

from sci_lightning.errors import BadInput

Value: TypeAlias = float | int | str


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
