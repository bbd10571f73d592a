"""The quadratic approximation of a fit's objective."""

from __future__ import annotations

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
