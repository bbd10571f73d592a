"""What all effects have in common: one named physical deviation from the ideal encoder."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any, ClassVar

import torch
from torch import nn

from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.encoder.exposure import Exposure
from sci_lightning.encoder.relay import Pose
from sci_lightning.encoder.signal import Signal
from sci_lightning.errors import BadInput

ROUNDING = 1e-6
"""Of a number that is kept in single precision, relative."""

STAGES = ("modulator", "relay", "exposure", "optics", "sensor")


class Effect(nn.Module):
    """A deviation from the ideal encoder, acting at one place on the light's way.

    A subclass says what it is in the class attributes and overrides the one method below that belongs to its stage.
    Numbers are tensors of no dimension that do not ask for gradients unless told to; choices are plain values.

    Args:
        values: parameters by name; those not given are at their neutral value (or the first start, without one).

    Raises:
        BadInput: an unknown parameter, or a value out of its range.
    """

    name: ClassVar[str]
    """What reports and configurations call it."""
    stage: ClassVar[str]
    """One of ``STAGES``."""
    rank: ClassVar[float]
    """Effects act in the order of their ranks: modulator 10 to 19, relay 20s, exposure 30s, optics 40s, sensor 50s."""
    about: ClassVar[dict[str, Parameter]]
    """Every parameter by name."""
    chart: ClassVar[str | None] = None
    """For an effect with an estimated map: ``pixel``, ``column``, ``row`` or ``hot`` (few pixels, the others 0)."""
    subpixel: ClassVar[bool] = False
    """Whether it matters to it where within a pixel the light falls; it then receives cells and gives pixels."""
    sentence: ClassVar[str] = ""
    """What the effect does, as a clause for reports in which ``{parameter}`` stands for a value: "the sensor's gain is
    {factor} times the nominal one". Without one, reports list the parameters."""
    noise: ClassVar[bool] = False
    """Whether it changes the variance of the signal and not its mean."""

    def __init__(self, **values: Any) -> None:
        super().__init__()
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
        found = {name: getattr(self, name) for name in self.about}
        return {name: value.item() if isinstance(value, torch.Tensor) else value for name, value in found.items()}

    def check(self) -> None:
        """Raise BadInput where a value is out of its range, which a state that was loaded may be."""
        for name, value in self.values.items():
            about = self.about[name]
            nearest = min(max(value, about.low), about.high) if isinstance(value, float) else value
            rounded = isinstance(value, float) and abs(value - float(nearest)) <= ROUNDING * max(1.0, abs(value))
            about.read(f"{self.name}.{name}", nearest if rounded else value)

    @classmethod
    def starts(cls, frames: int, size: tuple[int, int], bit_depth: int) -> list[dict[str, Value]]:
        """Settings from which a search sets out: every combination of the parameters' starts and choices.

        Args:
            frames: T. size: (H, W). bit_depth: of the converter.
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

    # One of these for each stage. Tensors may be windows of the whole field only where a Signal says so.

    def show(self, patterns: torch.Tensor) -> torch.Tensor:
        """Modulator: transmittance told ``(P, H, W)`` to transmittance shown."""
        return patterns

    def schedule(self, slots: int) -> torch.Tensor | None:
        """Modulator: ``(T, T)``, how much of slot s's pattern (column) is shown in slot t (row); None for none."""
        return None

    def aim(self, pose: Pose) -> Pose:
        """Relay: where the mask's image lies and how sharp it is."""
        return pose

    def expose(self, exposure: Exposure) -> Exposure:
        """Exposure: when the source shines and when each row looks."""
        return exposure

    def form(self, signal: Signal) -> Signal:
        """Optics: the image on the sensor; ``signal.mean`` is light, of no variance yet."""
        return signal

    def respond(self, signal: Signal) -> Signal:
        """Sensor: mean and variance of the signal before the converter."""
        return signal

    def undo(self, signal: Signal) -> Signal:
        """Optics, sensor: of a measurement, what it would be without this effect; as it is where nobody can tell."""
        return signal

    def effective_bits(self, bits: int) -> int:
        """Sensor: bits of the converter that count."""
        return bits

    def extra_repr(self) -> str:
        return ", ".join(
            f"{name}={value:.6g}" if isinstance(value, float) else f"{name}={value}"
            for name, value in self.values.items()
        )
