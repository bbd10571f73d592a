"""Does the misfit go with single captures, their kind or their order, or with what earlier captures leave?"""

from __future__ import annotations

import torch
from scipy.stats import f as fisher

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture, Regression, judge
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

POWERS = 3
"""A drift is a polynomial of this degree in the number of the capture."""


def kinds(residuals: Residuals) -> Answer:
    """Test the mean residual of every kind of capture."""
    names = tuple(sorted(set(residuals.observation.kinds)))
    members = [torch.tensor([kind == name for kind in residuals.observation.kinds]) for name in names]
    count = torch.tensor([residuals.raw[member].numel() for member in members]).double()
    mean = torch.stack([residuals.scaled[member].mean(dtype=torch.float64) for member in members])
    picture = Picture("bars", mean, unit="mean residual (σ)", x=names, axes=("kind",), errors=count.rsqrt())
    return judge(mean * count.sqrt(), picture)


def captures(residuals: Residuals) -> Answer:
    """Test the excess light of every capture, relative to its own; without light the mean residual."""
    values, errors = _light(residuals)
    scores = torch.zeros_like(values)
    scores[residuals.observation.number.argsort().argsort()] = values / errors
    numbers = tuple(str(n) for n in residuals.observation.number.sort().values.tolist())
    return judge(scores, Picture("bars", scores, x=numbers, axes=("capture, as in the file",)))


def drift(residuals: Residuals) -> Answer:
    """Test whether the light changes smoothly from capture to capture, beyond what captures differ by anyway.

    Captures without light are left out.
    """
    values, errors = _light(residuals)
    lit = torch.tensor([bool(mean.mean() > 1) for mean in residuals.prediction.mean])
    number, values, errors = residuals.observation.number[lit].double(), values[lit], errors[lit]
    order = number.argsort()
    picture = Picture(
        "curve",
        100 * values[order],
        unit="excess light (%)",
        x=tuple(number[order].tolist()),
        axes=("capture, as in the file",),
        errors=100 * errors[order],
    )
    left = len(values) - POWERS - 1
    if left < 1:
        return Answer(0.0, 1.0, 0.0, picture)
    place = 2 * (number - number.min()) / (number.max() - number.min()) - 1
    basis = torch.stack([place**power for power in range(POWERS + 1)], 1) / errors[:, None]
    scores = values / errors
    orthogonal = torch.linalg.qr(basis).Q
    along = orthogonal.T @ scores
    rest = float((scores - orthogonal @ along).square().sum())
    trend = float(along[1:].square().sum())
    statistic = trend / POWERS / max(1.0, rest / left)
    nats = max(0.0, trend - POWERS) / 2
    return Answer(statistic, float(fisher.sf(statistic, POWERS, left)), nats, picture)


def _light(residuals: Residuals) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the excess light ``(N,)`` as a part of the capture's own (of 1 without any), and its standard errors."""
    light = residuals.prediction.mean / residuals.observation.full_scale * residuals.sensitivity
    lit = (light.square().sum((1, 2)) > 0)[:, None, None]
    light = torch.where(lit, light, 1.0).double()
    weight = light.square().sum((1, 2))
    return (light * residuals.scaled).sum((1, 2)) / weight, weight.rsqrt()


LATER = 3
"""Captures back to which a remainder is looked for."""


def carry_over(residuals: Residuals) -> Answer:
    """Regress the residual on the pictures of earlier captures, without what resembles the capture's own picture."""
    pictures = residuals.prediction.mean / residuals.observation.full_scale
    place = {number: n for n, number in enumerate(residuals.observation.number.tolist())}
    regression = Regression(LATER)
    for number, n in place.items():
        weight = residuals.sensitivity[n]
        own = torch.linalg.qr(torch.stack((weight, weight * pictures[n]), -1).flatten(0, 1)).Q
        changes = torch.zeros(LATER, *weight.shape)
        for later in range(1, LATER + 1):
            if number - later in place:
                before = (pictures[place[number - later]] * weight).flatten()
                changes[later - 1] = (before - own @ (own.T @ before)).reshape(weight.shape)
        regression.add(changes, residuals.scaled[n])
    names = tuple(str(later) for later in range(1, LATER + 1))
    return regression.answer(names, "captures later", "part that remains")
