"""What is slightly wrong in every laboratory, and belongs to the captures, not to the camera.

Exposures jitter, and printed targets differ from what the file says: smoothly over the sheet, and from patch to patch.
Where a search has left something, every hypothesis of the next one contains these errors, each with a size that the
captures say and that a prior holds small (random effects: Laird and Ware, "Random-effects models for longitudinal
data", 1982). They are reported as what they are and are no names of the camera: a camera is not blamed for its
laboratory.
"""

from __future__ import annotations

from typing import ClassVar

import torch

from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.model.smooth_basis import MAX_DEGREE
from sci_lightning.encoder.effects import Effect, MapEffect, SensorEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.signal import Signal

MIN_CAPTURES_OF_SHEET = 4
"""Captures of the same even target from which the errors of its pixels can be told from noise."""


class ErrorOfLight(MapEffect, SensorEffect):
    """The light of some captures is a little more or less than nominal."""

    of_captures = imperfection = True
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.001, starts=(0.002,))}
    concerned: ClassVar[torch.Tensor]
    """``(F,)`` bool: the captures of the file that have this error."""
    typical: ClassVar[float]
    """Standard deviation of the half-normal prior of ``std``."""


class RelativeError(ErrorOfLight):
    """The light of a capture times 1 plus an error that captures of one group share.

    The map holds the error of every capture of the file, ``(F, H, W)``, or ``(F, 1, 1)`` where it is even.
    """

    map_kind = "capture"
    group: ClassVar[torch.Tensor]
    """``(F,)`` number of every capture's group; -1 for captures without this error."""
    degree: ClassVar[int]
    """Of the polynomials of the place that the error is a sum of, their degrees along both axes together."""

    @classmethod
    def shape(cls, size: tuple[int, int]) -> tuple[int, ...]:
        return (len(cls.group), *(size if cls.degree else (1, 1)))

    def respond(self, signal: Signal) -> Signal:
        if signal.position is None:
            return signal
        return signal.with_mean(signal.mean * (1 + self.std * signal.window(self.map[signal.position])))


class ExposureJitter(RelativeError):
    """Every capture has its own exposure, a little more or less than nominal.

    Args:
        std: relative standard deviation of the exposures, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "exposure_jitter"
    rank = 49.2
    sentence = "exposures jitter by {std}"
    degree = 0
    typical = 0.005


class TargetError(RelativeError):
    """Every target is a little lighter or darker than the file says, smoothly over the sheet.

    Args:
        std: relative standard deviation over a target, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "target_error"
    rank = 49.3
    sentence = "targets are lighter or darker than the file says by {std}"
    degree = 4
    typical = 0.01


class SheetShape(RelativeError):
    """The even target, a sheet or a lamp, is lighter in some places than in others, smoothly, in all of its captures.

    Args:
        std: relative standard deviation over the field, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "sheet_shape"
    rank = 49.2
    sentence = "the even target is uneven by {std}"
    degree = 2 * MAX_DEGREE
    typical = 0.01


class SheetError(ErrorOfLight):
    """The even target differs from pixel to pixel, likewise.

    Args:
        std: relative standard deviation over the field, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    map_kind = "pixel"
    name = "sheet_error"
    rank = 49.1
    sentence = "and from pixel to pixel by {std}"
    typical = 0.01

    def respond(self, signal: Signal) -> Signal:
        if signal.position is None:
            return signal
        error = self.std * signal.window(self.map) * self.concerned[signal.position][:, None, None]
        return signal.with_mean(signal.mean * (1 + error))


class TargetGrain(SensorEffect):
    r"""Textured targets differ from what the file says from place to place: the variance grows by :math:`(s\,m)^2`.

    Args:
        std: s, relative standard deviation, 0.0001 to 0.03.
    """

    name = "target_grain"
    rank = 49.4
    about = {"std": Parameter("1", 1e-4, 1e-4, 0.03, step=0.05, starts=(0.003,), log=True)}
    sentence = "targets differ from place to place by {std}"
    noise = True
    of_captures = imperfection = True
    std: torch.Tensor
    textured: ClassVar[torch.Tensor]
    """``(F,)`` bool: captures of a textured target."""

    def respond(self, signal: Signal) -> Signal:
        if signal.position is None:
            return signal
        grain = (self.std * signal.mean).square() * self.textured[signal.position][:, None, None]
        return signal.with_moments(signal.mean, signal.variance + grain)


class MovingGrain(TargetGrain):
    """The same for targets that move during a capture, whose grain is smeared."""

    name = "moving_grain"
    rank = 49.5
    sentence = "moving targets by {std}"


def imperfections_of(observation: Observation) -> dict[str, type[Effect]]:
    """Return the errors that the laboratory of these captures may have, by name.

    Args:
        observation: every capture of the file with a known scene.
    """
    position = observation.position
    if position is None:
        return {}
    count = int(position.max()) + 1
    target, even = observation.target, torch.tensor([scene.shape[1:] == (1, 1) for scene in observation.scene])
    lit = torch.tensor([bool(scene.any()) for scene in observation.scene])
    times = torch.bincount(target[even & lit], minlength=int(target.max()) + 1)
    sheet = int(times.argmax()) if int(times.max()) >= MIN_CAPTURES_OF_SHEET else -1
    moving = torch.tensor([len(scene) > 1 for scene in observation.scene]) & ~even
    single = lit & (target != sheet)
    group = torch.full((count,), -1)
    group[position] = torch.where(single, target, -1)
    classes: dict[str, type[Effect]] = {"exposure_jitter": _of_groups(ExposureJitter, torch.arange(count))}
    if sheet >= 0:
        concerned = _in_file(position, target == sheet, count)
        classes["sheet_shape"] = _of_groups(SheetShape, concerned.long() - 1)
        classes["sheet_error"] = _of(SheetError, concerned=concerned)
    if single.any():
        classes["target_error"] = _of_groups(TargetError, group)
    for effect, some in ((TargetGrain, single & ~moving), (MovingGrain, single & moving)):
        if some.any():
            classes[effect.name] = _of(effect, textured=_in_file(position, some, count))
    return classes


def _in_file(position: torch.Tensor, which: torch.Tensor, count: int) -> torch.Tensor:
    """Return for every capture of the file, ``(F,)`` bool, whether it is one of these."""
    of_file = torch.zeros(count, dtype=torch.bool)
    of_file[position] = which
    return of_file


def _of_groups(effect: type[RelativeError], group: torch.Tensor) -> type[Effect]:
    """Return a subclass that knows the group of every capture of the file, -1 for none."""
    return _of(effect, group=group, concerned=group >= 0)


def _of(effect: type[Effect], **captures: torch.Tensor) -> type[Effect]:
    """Return a subclass that knows which captures it is about."""
    body = {**captures, "__module__": effect.__module__, "__qualname__": effect.__qualname__}
    return type(effect.__name__, (effect,), body)
