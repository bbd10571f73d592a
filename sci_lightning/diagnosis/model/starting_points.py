"""Where fits of an effect start, and how an effect that limits the signal is adapted when another one is added."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.model.camera_model import CameraModel, behind
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.encoder.effects import Effect, SensorEffect
from sci_lightning.encoder.effects.stage import ModulatorEffect
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.signal import Signal

BISECTIONS = 24
"""Halvings of the range of the signal: single precision has no more digits."""


def starting_settings(model: CameraModel, name: str, hypothesis: Hypothesis) -> list[Setting]:
    """Return the settings from which a fit of an effect may start.

    An effect that limits the signal (saturation) may also start from the levels at which the brightest pixels pile up.
    """
    observation, effect = model.observation, model.effects[name]
    size = tuple(observation.patterns.shape[-2:]) if issubclass(effect, ModulatorEffect) else observation.size
    settings = effect.starts(observation.frames, (size[0], size[1]), observation.bit_depth)
    if parameter := _limiting_parameter(effect):
        after = behind(model.path(hypothesis), effect)
        levels = (_signal_recorded_as(model, after, level) for level in observation.pile_ups)
        settings += [{parameter: level} for level in levels if 0 < level < 1]
    return settings


def with_effect_at(model: CameraModel, hypothesis: Hypothesis, name: str, setting: Setting) -> Hypothesis:
    """Return the hypothesis with one more effect at a setting; its map, if it has one, is 0 everywhere.

    If the hypothesis limits the signal (saturation), the limit is adapted so that it is still recorded at the same
    DN: that is what the captures show, whatever the sensor does to the signal afterwards.
    """
    extended = hypothesis.with_effect(name, setting, model.zero_map(name))
    for other, other_setting in hypothesis.effects.items():
        limiting = model.effects[other]
        parameter = _limiting_parameter(limiting)
        if parameter and model.effects[name].rank > limiting.rank:
            level = torch.full((1, *model.observation.size), float(other_setting[parameter]))
            recorded = _recorded(model, behind(model.path(hypothesis), limiting), level)
            adapted = _signal_recorded_as(model, behind(model.path(extended), limiting), recorded)
            extended = extended.with_effect(other, {**extended.effects[other], parameter: adapted})
    return extended


def _limiting_parameter(effect: type[Effect]) -> str | None:
    """Return the parameter at which the signal ends, for an effect of the sensor that limits it."""
    return effect.ceiling if issubclass(effect, SensorEffect) else None


def _signal_recorded_as(model: CameraModel, after: LightPath, recorded: float) -> float:
    """Return the signal (fraction of full scale) that some effects of the sensor turn into ``recorded``."""
    low, high, one = 0.0, 1.0, torch.ones(1, *model.observation.size)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if _recorded(model, after, middle * one) > recorded else (middle, high)
    return (low + high) / 2


def _recorded(model: CameraModel, after: LightPath, even: torch.Tensor) -> float:
    """Return what some effects of the sensor turn an even signal into, in the median over the pixels."""
    exposure, observation = torch.ones(1, 1, 1), model.observation
    signal = Signal(even, torch.zeros(()), exposure, 1 / observation.full_scale, (0, 0), observation.size)
    return float(after.respond(signal).mean.median())
