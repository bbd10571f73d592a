"""Relative errors that belong to captures: the state of one kind of them during a fit.

The error of a capture is a sum of a few functions of the place, with factors that the captures of one group share: one
number for every exposure, a smooth field for every target. The factors are the values of the map. Their Gaussian prior
has the standard deviation that makes the captures likeliest, itself with a half-normal prior. Captures that a fit has
not seen say themselves what their errors are; the camera is judged by what is left.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch

from sci_lightning.diagnosis.model.camera_model import CameraModel, Evaluated
from sci_lightning.diagnosis.model.fixed_pattern_map import FixedPatternMap, likeliest_prior, penalty_of
from sci_lightning.diagnosis.model.hypothesis import Setting
from sci_lightning.diagnosis.model.imperfections import RelativeError
from sci_lightning.diagnosis.model.smooth_basis import MAX_DEGREE, orthonormal, prior

MAX_OWN_ERROR_STD = 3.0
"""Standard deviations of the prior by which an unseen capture may correct itself; more is a fault, and shows."""


@dataclass(frozen=True)
class CaptureFunctions:
    """Functions of the place, and the group of every capture.

    Attributes:
        group: ``(N,)`` of every capture here, -1 for none.
        count: G, groups of all captures of the file.
        of_file: ``(F,)`` group of every capture of the file.
        whole: ``(K, H, W)`` float64 functions on the field; ``(1, 1, 1)`` for an even error.
        seen: ``(K, h, w)`` the functions at the pixels that count.
        dual: ``(K, H, W)``; the sum of an error times these gives its factors.
    """

    group: torch.Tensor
    count: int
    of_file: torch.Tensor
    whole: torch.Tensor
    seen: torch.Tensor
    dual: torch.Tensor

    @staticmethod
    def of(model: CameraModel, effect: type[RelativeError]) -> CaptureFunctions:
        """Return the functions of an effect for the captures of a model."""
        (height, width), (rows, columns) = model.observation.size, model.window
        position = model.observation.position
        if position is None:
            raise ValueError(f"{effect.name}: captures without an order")
        whole = dual = torch.ones(1, 1, 1, dtype=torch.float64)
        if effect.degree:
            flat, degree = orthonormal(height, width)
            flat, spread = flat[degree <= effect.degree], prior(degree[degree <= effect.degree], 1.0)[:, None]
            even = torch.ones(1, height * width, dtype=torch.float64)  # a sheet as a whole has an error as well
            whole = torch.cat((even, flat * spread)).unflatten(1, (height, width))
            dual = torch.cat((even, flat / spread)).unflatten(1, (height, width)) / (height * width)
        seen = whole.expand(-1, height, width)[:, rows, columns].contiguous()
        count = int(effect.group.max()) + 1
        return CaptureFunctions(effect.group[position], count, effect.group, whole, seen, dual)

    @property
    def member(self) -> torch.Tensor:
        """``(N,)`` bool: captures that have such an error."""
        return self.group >= 0

    def gather(self, fields: torch.Tensor) -> torch.Tensor:
        """Sum fields ``(.., N, h, w)`` times every function over the captures of each group: ``(.., G, K)``."""
        own = fields[..., self.member, :, :].flatten(-2).double() @ self.seen.flatten(1).T
        total = torch.zeros(*own.shape[:-2], self.count, own.shape[-1], dtype=torch.float64)
        return total.index_add(-2, self.group[self.member], own)

    def spread(self, values: torch.Tensor) -> torch.Tensor:
        """Return the errors ``(.., N, h, w)`` of factors ``(.., G, K)``."""
        errors = (values.double() @ self.seen.flatten(1)).unflatten(-1, self.seen.shape[1:])
        return errors[..., self.group.clamp(min=0), :, :] * self.member[:, None, None]

    def columns(self, fields: torch.Tensor) -> torch.Tensor:
        """Sum a field ``(N, h, w)`` over the captures of each group, times every function: ``(G K, h, w)``."""
        total = torch.zeros(self.count, *fields.shape[1:])
        total.index_add_(0, self.group[self.member], fields[self.member].float())
        return (total[:, None] * self.seen.float()).flatten(0, 1)

    def gram(self, fields: torch.Tensor) -> torch.Tensor:
        """Sum a field ``(N, h, w)`` times every product of two functions within each group: ``(G, K, K)``."""
        columns = self.columns(fields).flatten(1) @ self.seen.flatten(1).T.float()
        return columns.unflatten(0, (self.count, -1)).double()

    def shared(self, other: CaptureFunctions, fields: torch.Tensor) -> torch.Tensor:
        """Sum a field ``(N, h, w)`` times every product with a function of another kind: ``(G K, G' K')``."""
        sums = torch.zeros(self.count, other.count, len(self.seen), len(other.seen), dtype=torch.float64)
        both = (self.member & other.member).nonzero()[:, 0]
        if len(both):
            own = (fields[both].double()[:, None] * self.seen).flatten(2) @ other.seen.flatten(1).T
            sums.index_put_((self.group[both], other.group[both]), own, accumulate=True)
        return sums.transpose(1, 2).flatten(2).flatten(0, 1)

    def factors(self, errors: torch.Tensor) -> torch.Tensor:
        """Return the factors ``(G, K)`` of the errors of all captures of the file, ``(F, H, W)``."""
        values = torch.zeros(self.count, len(self.dual), dtype=torch.float64)
        known = self.of_file >= 0
        values[self.of_file[known]] = errors[known].flatten(1).double() @ self.dual.flatten(1).T
        return values

    def errors(self, values: torch.Tensor) -> torch.Tensor:
        """Return the errors ``(F, H, W)`` of all captures of the file, for factors ``(G, K)``."""
        errors = (values @ self.whole.flatten(1)).unflatten(-1, self.whole.shape[1:])
        return (errors[self.of_file.clamp(min=0)] * (self.of_file >= 0)[:, None, None]).float()


@dataclass(frozen=True)
class CaptureMap(FixedPatternMap):
    """The state of the errors of captures during a fit; values are ``(G, K)``.

    Attributes:
        functions: of the place, and groups of captures.
        own: ``(G, K)`` values by which captures that no fit has seen correct themselves.
        own_information: ``(G, K)`` about them.
        gram: ``(G, K, K)`` information about the values, within each group.
    """

    functions: CaptureFunctions = field(kw_only=True)
    own: torch.Tensor = field(kw_only=True)
    own_information: torch.Tensor = field(kw_only=True)
    gram: torch.Tensor = field(kw_only=True)

    @property
    def shape(self) -> bool:
        """Whether the errors are as free as a smooth map of the camera."""
        return len(self.functions.seen) > (MAX_DEGREE + 1) ** 2 // 2

    @property
    def variance(self) -> torch.Tensor:
        return 1 / (self.likelihood_information + self.own_information + 1 / max(self.std, 1e-9) ** 2)

    @property
    def correction(self) -> torch.Tensor:
        return (self.jacobian * self.functions.spread(self.own)).float()

    @property
    def own_penalty(self) -> float:
        return penalty_of(self.own, self.own_information, self.std)

    @property
    def leverage(self) -> torch.Tensor:
        return self.jacobian.square() * self._error_variance.float()

    @property
    def _error_variance(self) -> torch.Tensor:
        """``(N, h, w)`` variance of the errors."""
        of_groups = (self.variance @ self.functions.seen.flatten(1).square()).unflatten(-1, self.jacobian.shape[1:])
        return of_groups[self.functions.group.clamp(min=0)] * self.functions.member[:, None, None]

    def gather(self, field: torch.Tensor) -> torch.Tensor:
        return self.functions.gather(field)

    def spread(self, values: torch.Tensor) -> torch.Tensor:
        return self.functions.spread(values)

    def shared_information(self, other: FixedPatternMap, shared: torch.Tensor) -> torch.Tensor:
        if isinstance(other, CaptureMap):
            return self.functions.shared(other.functions, shared)
        return other.reduce(self.functions.columns(shared)).flatten(1).double()

    def line_information(self, lost: torch.Tensor) -> torch.Tensor:
        prior_information = torch.eye(self.values.numel(), dtype=torch.float64) / max(self.std, 1e-9) ** 2
        return torch.block_diag(*self.gram) + prior_information

    def shared_variance(self, part: torch.Tensor) -> float:
        weight = part / self._error_variance.clamp(min=1e-30)
        gram = self.functions.gram(weight)
        pairs = gram.square() * self.variance[:, :, None] * self.variance[:, None]
        return float(pairs.sum() - part.square().sum())

    def moved(self, model: CameraModel, step: torch.Tensor) -> tuple[Setting, torch.Tensor]:
        return {"std": self.std}, self.functions.errors(self.values + step)

    def penalty_after(self, model: CameraModel, moved: Evaluated, information: torch.Tensor) -> float:
        """Return the penalty after a step; the information about so small errors hardly changes."""
        values = self.functions.factors(moved.hypothesis.maps[self.name])
        squares = float(values.square().sum() - self.values.square().sum())
        return self.penalty + 0.5 * squares / max(self.std, 1e-9) ** 2

    def of_other_captures(self, model: CameraModel, at: Evaluated) -> CaptureMap:
        """Return the same errors for other captures, which correct themselves where they are of other groups."""
        functions = CaptureFunctions.of(model, _class_of(model, self.name))
        jacobian = model.map_jacobian(at.hypothesis, self.name, at.prediction)
        unseen = self.likelihood_information.sum(1) == 0
        own, about = _own_errors(functions, jacobian, at, unseen, torch.zeros_like(jacobian), self.std)
        return replace(self, functions=functions, jacobian=jacobian, own=own, own_information=about)


def estimate_capture_map(model: CameraModel, at: Evaluated, name: str, fitted: torch.Tensor) -> CaptureMap:
    """Return the errors of captures at a hypothesis, with the prior that makes the captures likeliest.

    The arguments are those of :func:`~sci_lightning.diagnosis.model.smooth_map.estimate_map`.
    """
    effect = _class_of(model, name)
    functions = CaptureFunctions.of(model, effect)
    jacobian = model.map_jacobian(at.hypothesis, name, at.prediction)
    values = functions.factors(model.map_values(at.hypothesis, name))
    gradient = functions.gather(jacobian * at.likelihood.mean_gradient * fitted)
    gram = functions.gram(jacobian.square() * at.likelihood.mean_information * fitted)
    size, turn = torch.linalg.eigh(gram)
    size = size.clamp(min=0)
    from_zero = gradient + (gram @ values[..., None])[..., 0]
    along = (turn.mT @ from_zero[..., None])[..., 0]
    std, evidence, std_error = likeliest_prior(along, size, effect.typical)
    penalty = 0.5 * float((values / std).square().sum() + torch.log1p(std**2 * size).sum())
    penalty += 0.5 * (std / effect.typical) ** 2
    information = gram.diagonal(dim1=1, dim2=2)
    unseen = information.sum(1) == 0
    own, about = _own_errors(functions, jacobian, at, unseen, fitted, std)
    numbers = std, std_error, penalty, evidence
    return CaptureMap(
        name,
        "capture",
        values,
        jacobian,
        gradient,
        information,
        *numbers,
        of_captures=True,
        functions=functions,
        own=own,
        own_information=about,
        gram=gram,
    )


def _own_errors(
    functions: CaptureFunctions,
    jacobian: torch.Tensor,
    at: Evaluated,
    unseen: torch.Tensor,
    fitted: torch.Tensor,
    std: float,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the errors ``(G, K)`` that captures of unseen groups ``(G,)`` have by their own pixels, and how sure."""
    counted = (1 - fitted) * (unseen[functions.group.clamp(min=0)] & functions.member)[:, None, None]
    gradient = functions.gather(jacobian * at.likelihood.mean_gradient * counted)
    gram = functions.gram(jacobian.square() * at.likelihood.mean_information * counted)
    precision = gram + torch.eye(gram.shape[-1], dtype=gram.dtype) / max(std, 1e-9) ** 2
    values = torch.linalg.solve(precision, gradient[..., None])[..., 0]
    return values.clamp(-MAX_OWN_ERROR_STD * std, MAX_OWN_ERROR_STD * std), gram.diagonal(dim1=1, dim2=2)


def _class_of(model: CameraModel, name: str) -> type[RelativeError]:
    effect = model.effects[name]
    if not issubclass(effect, RelativeError):
        raise ValueError(f"{name} is no error of captures")
    return effect
