"""A hypothesis about the camera: which effects it has and how strong they are, and the one to begin with."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.encoder.effects.parameter import Value

Setting = dict[str, Value]
"""Values of an effect's parameters by name."""

ParameterName = tuple[str, str]
"""An effect's name and the name of one of its parameters."""

NOISE_GUESS = {"shot_noise": ("full_well", 1e4), "read_noise": ("std", 1.0)}
"""Noise effects of every camera, their parameter, and where a fit of it starts if the datasheet is silent."""


@dataclass(frozen=True)
class Hypothesis:
    """Which effects the camera has, and how strong they are.

    Attributes:
        effects: values by parameter, by effect.
        maps: ``(H, W)``, ``(1, W)`` or ``(H, 1)`` fixed-pattern maps by effect, in the effect's own unit.
    """

    effects: dict[str, Setting]
    maps: dict[str, torch.Tensor] = field(default_factory=dict)

    def with_effect(self, name: str, setting: Setting, values: torch.Tensor | None = None) -> Hypothesis:
        """Return the hypothesis with an effect added or changed; its map stays unless ``values`` are given."""
        maps = self.maps if values is None else {**self.maps, name: values}
        return Hypothesis({**self.effects, name: dict(setting)}, maps)

    def without(self, name: str) -> Hypothesis:
        """Return the hypothesis without an effect."""
        effects = {other: setting for other, setting in self.effects.items() if other != name}
        return Hypothesis(effects, {other: values for other, values in self.maps.items() if other != name})


def datasheet_noise(observation: Observation) -> tuple[Hypothesis, tuple[ParameterName, ...]]:
    """Return the ideal camera with the datasheet's noise, and the parameters that the datasheet states.

    Where the datasheet is silent, the parameter has the value from which a fit should start.
    """
    stated = {"shot_noise": observation.full_well, "read_noise": observation.read_noise}
    effects: dict[str, Setting] = {name: {parameter: guess} for name, (parameter, guess) in NOISE_GUESS.items()}
    fixed = tuple((name, parameter) for name, (parameter, _) in NOISE_GUESS.items() if stated[name] is not None)
    effects |= {name: {parameter: stated[name] or 0.0} for name, parameter in fixed}
    return Hypothesis(effects), fixed
