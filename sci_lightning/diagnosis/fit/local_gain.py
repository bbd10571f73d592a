"""What a small change of the mean would gain in log-likelihood, with every fitted parameter and map free to respond.

The log-likelihood is approximated by a quadratic function around a fit, as in Rao's score test, so that no candidate
has to be fitted to be scored.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.parameters import FreeParameters
from sci_lightning.diagnosis.model.map_system import MapSystem


@dataclass(frozen=True)
class JointGain:
    """The best linear combination of K changes of the mean.

    Attributes:
        nats: gain in log-likelihood.
        factors: ``(K,)`` of every change.
        deviations: ``(K,)`` standard deviations of the factors; infinite where the captures say nothing.
        gradient: ``(K,)`` of the log-likelihood with respect to the factors, everything else eliminated.
        information: ``(K, K)`` about the factors, everything else eliminated.
    """

    nats: float
    factors: torch.Tensor
    deviations: torch.Tensor
    gradient: torch.Tensor
    information: torch.Tensor

    def of(self, kept: torch.Tensor) -> JointGain:
        """Return the gain of some of the changes (indices) alone."""
        return _newton_step(self.gradient[kept], self.information[kept][:, kept])


class LocalGain:
    """The quadratic approximation of the log-likelihood around a fit.

    Args:
        fit: at its maximum.
        errors_follow: whether errors of the captures respond to a change; without them, changes are compared that these
            errors could nearly make as well.

    Attributes:
        fitter: of the fit.
        at: its hypothesis with prediction and likelihood.
        gradient, information: ``(N, H, W)`` of the fitted pixels with respect to their mean; 0 for the others.
    """

    def __init__(self, fit: Fit, errors_follow: bool = True) -> None:
        self.fitter, self.at = fit.fitter, fit.evaluated
        self.information = self.at.likelihood.mean_information * self.fitter.fitted
        self.gradient = self.at.likelihood.mean_gradient * self.fitter.fitted
        maps = [one for one in self.fitter.maps(self.at) if errors_follow or not one.of_captures]
        self._maps = MapSystem(maps, self.information)
        jacobian = FreeParameters(self.fitter.model, fit.free).jacobian(fit.hypothesis, fit.prediction)
        self._weighted = (jacobian * self.information).flatten(1)
        cross = self._maps.cross_information(jacobian * self.information)
        self._map_response = self._maps.solve(cross)
        self._map_step = self._maps.solve(self._maps.gradient[None])[0]
        self._own_gradient = (jacobian * self.gradient).flatten(1).sum(1).double() - cross @ self._map_step
        information = (self._weighted @ jacobian.flatten(1).T).double() - self._map_response @ cross.T
        self._inverse = torch.linalg.pinv(information, hermitian=True, rtol=1e-10)

    def gain_of_single_changes(self, changes: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the nats that every one of some changes gains alone, and by which factor: ``(K,)`` each.

        A change that would have to be reversed gains nothing.

        Args:
            changes: ``(K, N, H, W)`` of the mean, DN per unit of the factor.
        """
        flat = changes.flatten(1)
        cross = self._maps.cross_information(changes * self.information)
        gradient = (flat @ self.gradient.flatten()).double() - cross @ self._map_step
        size = (flat.square() @ self.information.flatten()).double() - (self._maps.solve(cross) * cross).sum(1)
        shared = (self._weighted @ flat.T).double() - self._map_response @ cross.T
        gradient -= shared.T @ self._inverse @ self._own_gradient
        size -= ((self._inverse @ shared) * shared).sum(0)
        factors = gradient.clamp(min=0) / size.clamp(min=1e-6)
        return 0.5 * gradient * factors, factors

    def joint_gain(self, changes: torch.Tensor) -> JointGain:
        """Return the gain of the best combination of changes ``(K, N, H, W)`` of the mean, DN per unit."""
        flat = changes.flatten(1)
        cross = torch.cat([self._maps.cross_information((change * self.information)[None]) for change in changes])
        gradient = (flat @ self.gradient.flatten()).double() - cross @ self._map_step
        information = torch.stack([(flat @ (change * self.information).flatten()).double() for change in changes])
        information -= self._maps.solve(cross) @ cross.T
        shared = (self._weighted @ flat.T).double() - self._map_response @ cross.T
        gradient -= shared.T @ self._inverse @ self._own_gradient
        information -= shared.T @ self._inverse @ shared
        return _newton_step(gradient, information)


def _newton_step(gradient: torch.Tensor, information: torch.Tensor) -> JointGain:
    """Take the Newton step to the maximum; directions about which there is no information stay where they are."""
    size = information.diagonal().clamp(min=1e-12).sqrt()
    scaled = information / size / size[:, None]
    inverse = torch.linalg.pinv(scaled, hermitian=True, rtol=1e-6) / size / size[:, None]
    factors = inverse @ gradient
    deviations = inverse.diagonal().clamp(min=0).sqrt()
    deviations = torch.where((deviations > 0) & (size > 1e-5), deviations, torch.inf)
    return JointGain(0.5 * float(gradient @ factors), factors, deviations, gradient, information)
