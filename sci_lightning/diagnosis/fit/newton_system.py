"""The quadratic approximation of a fit's objective."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.model.map_system import MapSystem


@dataclass(frozen=True)
class NewtonSystem:
    """The quadratic approximation of the objective at a hypothesis, the maps eliminated from it.

    Attributes:
        gradient: ``(p,)`` with respect to the free parameters.
        information: ``(p, p)`` about them.
        maps: the fixed-pattern maps, all at once.
        map_step: ``(1, S)`` Newton step of the map values if no parameter moves.
        map_response: ``(p, S)`` derivative of the best map step with respect to every parameter, sign reversed: after a
            step d of the parameters the maps move by ``map_step - d @ map_response``.
    """

    gradient: torch.Tensor
    information: torch.Tensor
    maps: MapSystem
    map_step: torch.Tensor
    map_response: torch.Tensor

    def gain(self, movable: torch.Tensor) -> float:
        """Return the nats that the step to the maximum gains if only some parameters (indices) may move."""
        gradient, information = self.gradient[movable], self.information[movable][:, movable]
        step = torch.linalg.lstsq(information, gradient[:, None], driver="gelsd").solution[:, 0]
        of_maps = float(self.map_step[0] @ self.maps.gradient)
        return 0.5 * (of_maps + float(gradient @ step))


@dataclass
class Damping:
    """How much the steps of a fit are damped: less after a step that was accepted, more after one that was not.

    Source: Levenberg, Quart. Appl. Math. 2, 164 (1944); Marquardt, J. SIAM 11, 431 (1963).

    Attributes:
        most: steps that are tried in an iteration, each with more damping than the one before.
        value: what is added to the information, as a part of its diagonal.
        accepted: whether the attempt under way was accepted; set by the fit.
    """

    most: int
    value: float = 1e-3
    accepted: bool = False

    def attempts(self) -> Iterator[int]:
        """Yield the numbers of an iteration's attempts, from 0 on, until one was accepted."""
        for attempt in range(self.most):
            self.accepted = False
            yield attempt
            if self.accepted:
                self.value = max(self.value / 10, 1e-6)
                return
            self.value = max(self.value * 20, 1e-2)
