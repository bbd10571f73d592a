"""The free parameters of a hypothesis as one vector: finite differences, and steps within bounds.

A parameter whose size is unknown (``Parameter.log``) is fitted as its logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, ParameterName
from sci_lightning.diagnosis.model.likelihood import Prediction

DIFFERENCE_STEPS = 0.1
"""Part of a parameter's step over which the prediction is differentiated; the prediction is smooth."""
FINE_DIFFERENCE_STEPS = 1e-3
"""Part of a parameter's step over which the log-likelihood itself is differentiated, which is curved."""
MAX_STEPS = 20
"""Steps of a parameter that one iteration may move it by: further, its derivative says nothing."""
MAX_NOISE_STEP_SHARE = 0.5
"""The same for noise, as a part of its distance from none, if that is more: what has stood in for an effect is many
times as strong as it should be."""
MAX_LOG_STEP = 1.5
"""The same for a logarithm, in natural units."""
TEST_STEP = 1e-9
"""A step that leads out of the bounds only where a parameter is at one of them."""


@dataclass(frozen=True)
class FreeParameters:
    """The p parameters that a fit may move; choices and the scales of maps are found otherwise.

    Attributes:
        model: knows every effect's parameters.
        names: of effect and parameter, in the order of all ``(p, ..)`` tensors.
    """

    model: CameraModel
    names: tuple[ParameterName, ...]

    @staticmethod
    def of(model: CameraModel, hypothesis: Hypothesis, fixed: tuple[ParameterName, ...] = ()) -> FreeParameters:
        """Return the free parameters of a hypothesis, of which some may be fixed."""
        names = []
        for name in hypothesis.effects:
            effect = model.effects[name]
            if effect.map_kind is None:
                names += [
                    (name, parameter)
                    for parameter in hypothesis.effects[name]
                    if not effect.about[parameter].choices and (name, parameter) not in fixed
                ]
        return FreeParameters(model, tuple(names))

    def __len__(self) -> int:
        return len(self.names)

    def neighbours(
        self, hypothesis: Hypothesis, part: float = DIFFERENCE_STEPS
    ) -> Iterator[tuple[float, Hypothesis, Prediction]]:
        """For each parameter yield a small change, the hypothesis with it, and what that predicts.

        Args:
            hypothesis: where to differentiate.
            part: of the parameter's step that is taken: away from the neutral value if it is positive (a logarithm
                grows), and the other way where that would leave the bounds.
        """
        for name, parameter in self.names:
            about = self.model.effects[name].about[parameter]
            value = float(hypothesis.effects[name][parameter])
            step = about.step * part
            if isinstance(about.neutral, (int, float)) and not about.log and value < about.neutral:
                step = -step  # away from doing nothing, where footprints of pixels and mirrors have their kink
            start = math.log(value) if about.log else value
            moved = math.exp(start + step) if about.log else start + step
            if not about.low <= moved <= about.high:
                step = -step
                moved = math.exp(start + step) if about.log else start + step
            neighbour = hypothesis.with_effect(name, {**hypothesis.effects[name], parameter: moved})
            yield step, neighbour, self.model.predict(neighbour)

    def jacobian(self, hypothesis: Hypothesis, prediction: Prediction) -> torch.Tensor:
        """Return the derivatives ``(p, N, H, W)`` of the mean with respect to every parameter, DN per unit."""
        derivatives = torch.empty(len(self), *prediction.mean.shape)
        for i, (step, _, neighbour) in enumerate(self.neighbours(hypothesis)):
            derivatives[i] = (neighbour.mean - prediction.mean) / step
        return derivatives

    def movable(self, hypothesis: Hypothesis, gradient: torch.Tensor) -> torch.Tensor:
        """Return the indices of the parameters that a gradient ``(p,)`` does not press against a bound."""
        steps = (math.copysign(TEST_STEP, float(slope)) for slope in gradient)
        free = [self._limit(hypothesis, name, step) is None for name, step in zip(self.names, steps, strict=True)]
        return torch.tensor(free, dtype=torch.bool).nonzero()[:, 0]

    def newton_step(
        self, hypothesis: Hypothesis, gradient: torch.Tensor, information: torch.Tensor, damping: float
    ) -> tuple[Hypothesis, torch.Tensor]:
        """Take one damped Newton step (Levenberg and Marquardt) within the bounds.

        Parameters that are pressed against a bound stay there, and the step of the others is computed without them.

        Args:
            hypothesis: where to start.
            gradient: ``(p,)`` of the log-likelihood.
            information: ``(p, p)`` about the parameters.
            damping: part of the information's diagonal that is added to it.

        Returns:
            the moved hypothesis, and the step ``(p,)`` that was taken.
        """
        count = len(self)
        step = torch.zeros(count, dtype=torch.float64)
        inside = torch.ones(count, dtype=torch.bool)
        diagonal = information.diagonal().clamp(min=1e-9)
        for _ in range(count + 1):
            index = inside.nonzero()[:, 0]
            if not len(index):
                break
            matrix = information[index][:, index] + torch.diag(damping * diagonal[index])
            step.zero_()
            step[index] = torch.linalg.lstsq(matrix, gradient[index][:, None], driver="gelsd").solution[:, 0]
            limits = {i: self._limit(hypothesis, self.names[i], float(step[i])) for i in index.tolist()}
            pressed = [i for i, limit in limits.items() if limit is not None and abs(limit) < 1e-12]
            if not pressed:
                break
            inside[pressed] = False
        step[~inside] = 0
        moved = hypothesis
        for i, (name, parameter) in enumerate(self.names):
            limit = self._limit(hypothesis, (name, parameter), float(step[i]))
            if limit is not None:
                step[i] = limit
            about = self.model.effects[name].about[parameter]
            value = float(hypothesis.effects[name][parameter])
            new = value * math.exp(float(step[i])) if about.log else value + float(step[i])
            new = math.remainder(new, about.period) if about.period else min(max(new, about.low), about.high)
            moved = moved.with_effect(name, {**moved.effects[name], parameter: new})
        return moved, step

    def _limit(self, hypothesis: Hypothesis, which: ParameterName, step: float) -> float | None:
        """Return the longest step in the same direction that is allowed; None if the step itself is."""
        name, parameter = which
        about = self.model.effects[name].about[parameter]
        value = float(hypothesis.effects[name][parameter])
        if about.log:
            low, high = math.log(max(about.low, 1e-300) / value), math.log(about.high / value)
            low, high = max(low, -MAX_LOG_STEP), min(high, MAX_LOG_STEP)
        else:
            longest = MAX_STEPS * about.step
            if self.model.effects[name].noise and isinstance(about.neutral, (int, float)):
                longest = max(longest, MAX_NOISE_STEP_SHARE * abs(value - about.neutral))
            low, high = max(about.low - value, -longest), min(about.high - value, longest)
        if step < low:
            return low
        return high if step > high else None
