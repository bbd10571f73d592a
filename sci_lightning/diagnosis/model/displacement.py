"""Effects that displace the mask's image, and where fits of them start."""

from __future__ import annotations

from collections.abc import Iterable

from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis, Setting
from sci_lightning.encoder.effects.parameter import within
from sci_lightning.encoder.effects.stage import RelayEffect

Displacement = tuple[float, float]
"""(dx, dy) in pixels, +x right and +y down."""


def displacing_effects(model: CameraModel, hypothesis: Hypothesis) -> dict[str, tuple[str, str]]:
    """Return the names of the parameters dx and dy of every effect that displaces and is not in a hypothesis."""
    return {
        name: effect.displacement
        for name, effect in model.vocabulary.items()
        if issubclass(effect, RelayEffect) and effect.displacement and name not in hypothesis.effects
    }


def beside(peaks: Iterable[Displacement], aside: float) -> list[Displacement]:
    """Return displacements to all four sides of whole numbers of pixels, where linear interpolation has a kink."""
    sides = [(right, below) for right in (-aside, aside) for below in (-aside, aside)]
    return list(dict.fromkeys((dx + right, dy + below) for dx, dy in peaks for right, below in sides))


def starts_at(
    displacements: Iterable[Displacement], effects: dict[str, tuple[str, str]], model: CameraModel
) -> dict[str, list[Setting]]:
    """Return the settings of every effect at the displacements that lie within its bounds."""
    displacements, starts = list(displacements), {}
    for name, (dx, dy) in effects.items():
        there: list[Setting] = [{dx: x, dy: y} for x, y in displacements]
        starts[name] = [setting for setting in there if within(setting, model.effects[name].about)]
    return starts
