"""Does the misfit go with single captures, their kind, or the order in which they were taken?"""

from __future__ import annotations

import torch
from scipy.stats import f as fisher

from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.residual_tests.significance import judge

POWERS = 3
"""A drift is a polynomial of this degree in the number of the capture."""


def kinds(residuals: Residuals) -> Answer:
    """Mean residual of every kind of capture."""
    names = tuple(sorted(set(residuals.observation.kinds)))
    members = [torch.tensor([each == name for each in residuals.observation.kinds]) for name in names]
    count = torch.tensor([residuals.raw[each].numel() for each in members]).double()
    mean = torch.stack([residuals.scaled[each].mean(dtype=torch.float64) for each in members])
    picture = Picture("bars", mean, unit="mean residual (σ)", x=names, axes=("kind",), errors=count.rsqrt())
    return judge(mean * count.sqrt(), picture)


def captures(residuals: Residuals) -> Answer:
    """Light beyond the model in every capture, relative to its own; the mean residual, where there is no light."""
    values, errors = _light(residuals)
    scores = torch.zeros_like(values)
    scores[residuals.observation.number.argsort().argsort()] = values / errors
    numbers = tuple(str(n) for n in residuals.observation.number.sort().values.tolist())
    return judge(scores, Picture("bars", scores, x=numbers, axes=("capture, as in the file",)))


def drift(residuals: Residuals) -> Answer:
    """Whether the light changes smoothly from capture to capture, beyond what captures differ by anyway.

    Of captures without light nothing is asked.
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
    """``(N,)`` light beyond the model, as a part of the capture's own light (1 without any), and standard errors."""
    light = residuals.prediction.mean / residuals.observation.full_scale * residuals.sensitivity
    lit = (light.square().sum((1, 2)) > 0)[:, None, None]
    light = torch.where(lit, light, 1.0).double()
    weight = light.square().sum((1, 2))
    return (light * residuals.scaled).sum((1, 2)) / weight, weight.rsqrt()
