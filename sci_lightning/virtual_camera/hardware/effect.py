"""What every hidden effect has in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.parameter import Parameter, Value

if TYPE_CHECKING:
    from sci_lightning.virtual_camera.session import Session

E = TypeVar("E", bound="Effect")


@dataclass(frozen=True)
class Effect:
    """A physical deviation from the ideal camera; the dataclass fields are its parameters.

    Attributes:
        name: what the effect is called in truth files and on the command line.
        stage: where on the light's way it sits: modulator, relay, exposure, optics or sensor.
        gaussian: its chart is Gaussian numbers, of which a diagnosis knows nothing beforehand.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    gaussian: ClassVar[bool] = False

    @classmethod
    def parameters(cls) -> dict[str, Parameter]:
        """Every parameter by name."""
        return {each.name: each.metadata["parameter"] for each in fields(cls)}

    @property
    def values(self) -> dict[str, Value]:
        """Every parameter's value by name."""
        return {name: getattr(self, name) for name in self.parameters()}

    @classmethod
    def read(cls: type[E], values: Mapping[str, Any], session: Session) -> E:
        """The effect with the given parameters, those not given at their neutral value; BadInput if it cannot be."""
        known = cls.parameters()
        unknown = [name for name in values if name not in known]
        if unknown:
            raise BadInput(f"effect {cls.name} has no parameter '{unknown[0]}'; it has {', '.join(known)}")
        given = {name: known[name].read(f"{cls.name}.{name}", value) for name, value in values.items()}
        effect = replace(cls.neutral(session), **given)
        effect.check(session)
        return effect

    @classmethod
    def neutral(cls: type[E], session: Session) -> E:
        """The effect at the parameters that leave the session's camera as it is."""
        return cls()

    @classmethod
    def draw(cls: type[E], random: np.random.Generator, session: Session) -> E:
        """The effect at random parameters, clear to see in a full session."""
        neutral = cls.neutral(session)
        drawn = {name: about.draw(random, getattr(neutral, name)) for name, about in cls.parameters().items()}
        return replace(neutral, **drawn)

    @classmethod
    def suits(cls, session: Session) -> bool:
        """Whether the effect can show in the session at all, and so may be drawn for it."""
        return True

    def check(self, session: Session) -> None:
        """Raise BadInput if the parameters do not fit the session's size, slots or bits."""

    def weakened(self: E, share: float, session: Session) -> E:
        """The effect with its magnitudes at ``share`` of their distance from neutral."""
        neutral = self.neutral(session)
        magnitudes = [name for name, about in self.parameters().items() if about.magnitude and not about.integer]
        start = {name: getattr(neutral, name) for name in magnitudes}
        return replace(self, **{name: start[name] + share * (getattr(self, name) - start[name]) for name in magnitudes})

    def chart(self, random: np.random.Generator, size: tuple[int, int]) -> np.ndarray | None:
        """The map that belongs to this camera alone (its per-pixel gains, its dust, ..), where the effect has one."""
        return None
