"""Smooth maps: their state during a fit, and the estimate of any map."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from sci_lightning.diagnosis.model.camera_model import CameraModel, Evaluated
from sci_lightning.diagnosis.model.capture_map import CaptureMap, estimate_capture_map
from sci_lightning.diagnosis.model.fixed_pattern_map import (
    FixedPatternMap,
    estimate_pattern,
    likeliest_prior,
    penalty_of,
)
from sci_lightning.diagnosis.model.map_system import MapSystem
from sci_lightning.diagnosis.model.smooth_basis import SmoothBasis, orthonormal, prior

PRIOR_STEEPNESSES = (1.0, 2.0, 3.0, 4.0)
"""Powers of the degree with which the prior of a smooth map may fall; the most likely one counts. A steeper prior would
ask for more digits than maps in single precision have."""


def estimate_map(
    model: CameraModel, at: Evaluated, name: str, fitted: torch.Tensor, others: Sequence[FixedPatternMap] = ()
) -> FixedPatternMap:
    """Return the map of an effect at a hypothesis, with the prior that makes the captures likeliest.

    Args:
        model: predicts hypotheses.
        at: a hypothesis that need not contain the effect yet; its map is then taken at 0.
        name: of an effect with a map.
        fitted: ``(N, H, W)``, 1 for fitted pixels and 0 for held-out ones.
        others: maps of the hypothesis, which may say what this one says as well.
    """
    kind = model.effects[name].map_kind
    if kind == "capture":
        return estimate_capture_map(model, at, name, fitted)
    if kind == "smooth":
        return _estimate_smooth_map(model, at, name, fitted, others)
    return estimate_pattern(model, at, name, fitted, others)


def _estimate_smooth_map(
    model: CameraModel, at: Evaluated, name: str, fitted: torch.Tensor, others: Sequence[FixedPatternMap]
) -> FixedPatternMap:
    """Return the state of a smooth map ``(H, W)``; the arguments are as above.

    Prior and standard error are those that suit what the other maps leave. The standard error is that of the map's
    standard deviation over the field.
    """
    values = model.map_values(at.hypothesis, name)
    jacobian = model.map_jacobian(at.hypothesis, name, at.prediction)
    information = at.likelihood.mean_information * fitted
    slope = (jacobian * at.likelihood.mean_gradient * fitted).sum(0)
    curvature = (jacobian.square() * information).sum(0)
    flat, degree = orthonormal(*model.observation.size)
    about = (flat * model.whole(curvature).flatten().double()) @ flat.T
    along = flat @ model.whole(slope).flatten().double()
    if others:
        system = MapSystem(others, information)
        functions = model.windowed(flat.unflatten(1, model.observation.size)).float()
        cross = torch.cat([_shared(functions, one, jacobian * one.jacobian * information) for one in system.maps], 1)
        response = system.solve(cross)
        about, along = about - response @ cross.T, along - response @ system.gradient
    factors = flat @ values.flatten().double() / values.numel()
    steepness, std, evidence = _smoothest_prior(about, along + about @ factors, degree)
    basis = SmoothBasis.of(model.whole(curvature), steepness, model.window)
    coordinates, gradient = basis.coordinates(values), basis.reduce(slope)
    about_coordinates = basis.squares(curvature)
    mixed = basis.mixing @ coordinates
    direction = basis.mixing.T @ (mixed / mixed.norm().clamp(min=1e-12))
    precision = basis.mixing.T @ about @ basis.mixing
    precision = precision + torch.eye(len(coordinates), dtype=torch.float64) / max(std, 1e-9) ** 2
    std_error = float((direction @ torch.linalg.solve(precision, direction)).sqrt()) if len(direction) else 0.0
    numbers = std, std_error, penalty_of(coordinates, about_coordinates, std), evidence
    of_pixels = model.whole(slope), model.whole(curvature)
    return FixedPatternMap(
        name, "smooth", coordinates, jacobian, gradient, about_coordinates, *numbers, basis, *of_pixels
    )


def _shared(functions: torch.Tensor, other: FixedPatternMap, product: torch.Tensor) -> torch.Tensor:
    """Return the information ``(K, S)`` that factors of functions ``(K, h, w)`` share with the values of another map.

    Args:
        functions: of the place.
        other: the map.
        product: ``(N, h, w)`` of both slopes and the information about the mean.
    """
    if isinstance(other, CaptureMap):
        columns = other.functions.columns(product).flatten(1)
        return (functions.flatten(1) @ columns.T).double()
    return other.reduce(functions * product.sum(0)).flatten(1).double()


def _smoothest_prior(about: torch.Tensor, along: torch.Tensor, degree: torch.Tensor) -> tuple[float, float, float]:
    """Return steepness and standard deviation of the prior of the largest marginal likelihood, and its gain in nats.

    Args:
        about: ``(K, K)`` information about the factors of the orthonormal functions.
        along: ``(K,)`` gradient with respect to them, at a map of zeros.
        degree: ``(K,)`` of the functions.
    """
    best = (PRIOR_STEEPNESSES[0], 1e-6, -math.inf)
    for steepness in PRIOR_STEEPNESSES:
        spread = prior(degree, steepness)
        information, turn = torch.linalg.eigh(spread[:, None] * about * spread)
        std, evidence, _ = likeliest_prior(turn.T @ (spread * along), information.clamp(min=0))
        if evidence > best[2]:
            best = steepness, std, evidence
    return best
