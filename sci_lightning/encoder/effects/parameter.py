"""One parameter of an effect: its unit, its range, its neutral value, and where a search for it starts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from sci_lightning.errors import BadInput

Value: TypeAlias = float | int | str


@dataclass(frozen=True)
class Parameter:
    """A number within bounds, or a choice.

    Attributes:
        unit: ``pixel``, for example; ``1`` for a ratio, empty for a choice.
        neutral: the value at which the effect is the identity; None where there is none (the phase of a flicker).
        low, high: bounds of a number, both included.
        step: a small difference that is visible in the measurement; numerical derivatives are taken over it.
        inexact: what the formula of the effect may be wrong by where it does nothing, as the parameter's standard
            deviation; a small part of a step where it is less.
        starts: values at which a search starts; the neutral value need not be among them.
        choices: all values of a discrete parameter, in place of bounds; a search tries every one.
        period: of an angle; values that differ by it do the same, and a fit reports the one nearest to 0.
        log: whether the logarithm is fitted, as for a positive number of unknown magnitude; ``step`` is then relative.
    """

    unit: str
    neutral: Value | None
    low: float = -math.inf
    high: float = math.inf
    step: float = 1e-2
    inexact: float = 0.0
    starts: tuple[float, ...] = ()
    choices: tuple[Value, ...] = ()
    log: bool = False
    period: float | None = None

    def read(self, where: str, value: Any) -> Value:
        """Return ``value`` as this parameter takes it, a number as a float.

        Raises:
            BadInput: not a number, not finite, out of bounds, or not one of the choices; names ``where``.
        """
        if self.choices:
            if value not in self.choices:
                raise BadInput(f"{where} must be one of {', '.join(map(str, self.choices))}; got {value!r}")
            return value
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not self.low <= value <= self.high or not math.isfinite(value):
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise BadInput(f"{where} must be a number from {self.low:g} to {self.high:g}{unit}, got {value!r}")
        return float(value)


def part_of(setting: Mapping[str, Value], about: Mapping[str, Parameter], part: float) -> dict[str, Value]:
    """Return a setting of several parameters whose distance from the neutral one is multiplied by ``part``.

    Choices, and numbers without a neutral value, stay as they are; no number leaves its bounds. Numbers that are fitted
    as logarithms are multiplied like all others.
    """

    def moved(value: Value, parameter: Parameter) -> Value:
        if part == 1 or parameter.choices or not isinstance(parameter.neutral, (int, float)):
            return value
        far = parameter.neutral + part * (float(value) - parameter.neutral)
        return min(max(far, parameter.low), parameter.high)

    return {name: moved(value, about[name]) for name, value in setting.items()}


def within(setting: Mapping[str, Value], about: Mapping[str, Parameter]) -> bool:
    """Return whether no number of a setting leaves its bounds."""
    numbers = ((float(value), about[name]) for name, value in setting.items() if not about[name].choices)
    return all(known.low <= value <= known.high for value, known in numbers)
