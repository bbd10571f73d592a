"""One number (or choice) of an effect: what it may be, and how a seed draws it."""

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
    """Unit, range and draw of a parameter.

    Attributes:
        unit: as in ``pixel``; ``1`` for a ratio, empty for a choice.
        low, high: the values that are possible, both included.
        drawn: the span to draw from. A ``magnitude`` is drawn as its distance from the neutral value, uniform in the
            logarithm; anything else as the value itself, uniform.
        signed: a magnitude may lie on either side of its neutral value.
        magnitude: scales how much the effect does; a weak effect has this one reduced and the others as they are.
        integer: whole numbers only.
        choices: the words that are possible, for a parameter that is no number.
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
        """A value by chance, clear to see and on no grid; ``neutral`` is where the effect does nothing."""
        if self.choices:
            return str(random.choice([choice for choice in self.choices if choice != neutral]))
        if self.integer:
            return int(random.integers(int(self.drawn[0]), int(self.drawn[1]), endpoint=True))
        if not self.magnitude:
            return float(random.uniform(*self.drawn))
        distance = math.exp(random.uniform(math.log(self.drawn[0]), math.log(self.drawn[1])))
        upwards = random.random() < 0.5 if self.signed else float(neutral) < self.high
        return float(neutral) + (distance if upwards else -distance)

    def read(self, where: str, value: Any) -> Value:
        """``value`` as this parameter's type; BadInput, naming ``where``, when it is none or out of range."""
        if self.choices:
            if value not in self.choices:
                raise BadInput(f"{where} must be one of {', '.join(self.choices)}; got {value!r}")
            return str(value)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not self.low <= value <= self.high or (self.integer and value != int(value)):
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
    """A dataclass field that is a :class:`Parameter`; its default is the neutral value, where there is one."""
    about = Parameter(unit, low, high, (drawn[0], drawn[1]), signed, magnitude, integer)
    return field(default=neutral, metadata={"parameter": about})


def choice(*words: str, neutral: str) -> Any:
    """A dataclass field that is one of ``words``."""
    return field(default=neutral, metadata={"parameter": Parameter("", choices=words, magnitude=False)})
