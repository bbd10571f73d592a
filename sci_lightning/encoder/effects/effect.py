"""The base class of all effects: a named physical deviation from the ideal encoder, with bounded parameters."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any, ClassVar

import torch
from torch import nn

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.errors import BadInput

ROUNDING = 1e-6
"""Relative error of a number that is kept in single precision."""


class Effect(nn.Module):
    """A deviation from the ideal encoder at one stage of the light's way.

    An effect derives from the base class of its stage in :mod:`sci_lightning.encoder.effects.stage`, sets ``name``,
    ``rank`` and ``about``, and overrides the hooks that it needs. Parameters that are numbers become tensors of no
    dimension that take no gradient unless asked to; parameters that are choices stay plain values.

    Args:
        values: parameters by name; one that is not given is at its neutral value, or at its first start if it has none.

    Raises:
        BadInput: an unknown parameter, or a value out of its range.
    """

    name: ClassVar[str]
    """The effect's name in reports and configurations."""
    stage: ClassVar[str]
    """``modulator``, ``relay``, ``exposure``, ``optics`` or ``sensor``; set by the base class of the stage."""
    rank: ClassVar[float]
    """Effects act in the order of their ranks: modulator from 10, relay 20, exposure 30, optics 40, sensor 50 to 60."""
    about: ClassVar[dict[str, Parameter]]
    """Every parameter by name: its unit, its range, its neutral value and where a search for it starts."""
    map_kind: ClassVar[str | None] = None
    """For an effect with an estimated map: ``pixel``, ``column``, ``row``, ``hot`` (few pixels, the others 0),
    ``smooth`` (no detail much finer than an eighth of the field) or ``capture`` (an error of every capture)."""
    map_unit: ClassVar[str] = ""
    """Unit of the map's values; empty where it is that of the first parameter."""
    centred_by: ClassVar[str] = ""
    """For a map of rows or columns, the effect that is what they share: beside it, the mean of the map is 0."""
    displacement: ClassVar[tuple[str, str] | None] = None
    """The parameters that displace the mask's image, or the target, to the right and down, in pixels, for an effect
    that does nothing else. A diagnosis then looks more closely around its best start, and for displacements of the
    mask that are far from every start."""
    of_captures: ClassVar[bool] = False
    """Whether it belongs to the captures and not to the camera, so that no encoder file keeps it."""
    imperfection: ClassVar[bool] = False
    """Whether it is to be expected of every camera or laboratory, so that a diagnosis gives its size and no name."""
    noise: ClassVar[bool] = False
    """Whether the effect changes the variance of the signal and not its mean."""
    plainer: ClassVar[str | None] = None
    """Name of the effect that a diagnosis prefers as long as captures do not tell this one from it."""
    sentence: ClassVar[str] = ""
    """What the effect does, as a clause for reports in which ``{parameter}`` stands for a value: "the sensor's gain is
    {factor} times the nominal one". Without one, reports list the parameters."""

    def __init__(self, **values: Any) -> None:
        super().__init__()
        if not hasattr(self, "name"):
            raise BadInput(f"{type(self).__name__} is a base class of effects; name one of the effects")
        for name in values:
            if name not in self.about:
                raise BadInput(f"effect {self.name} has no parameter '{name}'; it has {', '.join(self.about)}")
        for name, about in self.about.items():
            default = about.neutral if about.neutral is not None else about.starts[0]
            value = about.read(f"{self.name}.{name}", values.get(name, default))
            if isinstance(value, float):
                setattr(self, name, nn.Parameter(torch.tensor(value), requires_grad=False))
            else:
                setattr(self, name, value)

    @property
    def values(self) -> dict[str, Value]:
        """Every parameter's value by name."""
        values = {name: getattr(self, name) for name in self.about}
        return {name: value.item() if isinstance(value, torch.Tensor) else value for name, value in values.items()}

    @property
    def is_neutral(self) -> bool:
        """Whether every parameter is at its neutral value, where the effect does nothing."""
        return all(value == self.about[name].neutral for name, value in self.values.items())

    @classmethod
    def is_discrete(cls) -> bool:
        """Return whether a parameter is chosen from a few values, so that no fit leads from one to the next."""
        return any(about.choices for about in cls.about.values())

    def border(self, size: tuple[int, int]) -> Border:
        """Return how far what lies beyond a field of ``size`` (H, W) reaches into it through this effect.

        A diagnosis that does not know what lies there leaves these pixels out. An effect that moves or spreads light
        overrides this.
        """
        return Border()

    def check(self) -> None:
        """Raise BadInput if a value is out of its range, which may happen when a state is loaded."""
        for name, value in self.values.items():
            about = self.about[name]
            nearest = min(max(value, about.low), about.high) if isinstance(value, float) else value
            rounded = isinstance(value, float) and abs(value - float(nearest)) <= ROUNDING * max(1.0, abs(value))
            about.read(f"{self.name}.{name}", nearest if rounded else value)

    @classmethod
    def starts(cls, frames: int, size: tuple[int, int], bit_depth: int) -> list[dict[str, Value]]:
        """Return the settings at which a search starts: every combination of the parameters' starts and choices.

        Args:
            frames: T.
            size: (H, W).
            bit_depth: bits of the converter.
        """
        ways = [about.choices or about.starts for about in cls.about.values()]
        settings = [dict(zip(cls.about, way, strict=True)) for way in product(*ways)]
        neutral = {name: about.neutral for name, about in cls.about.items()}
        return [setting for setting in settings if setting != neutral]

    @classmethod
    def describe(cls, values: Mapping[str, str]) -> str:
        """Return what the effect does, as a clause of a report.

        Args:
            values: every parameter's value by name, as text with the digits that are meant to be read.
        """
        if cls.sentence:
            return cls.sentence.format(**values)
        units = {name: parameter.unit.removeprefix("1") for name, parameter in cls.about.items()}
        listed = (f"{name} {value} {units.get(name, '')}".strip() for name, value in values.items())
        return f"{cls.name} ({', '.join(listed)})"

    def extra_repr(self) -> str:
        return ", ".join(
            f"{name}={value:.6g}" if isinstance(value, float) else f"{name}={value}"
            for name, value in self.values.items()
        )
