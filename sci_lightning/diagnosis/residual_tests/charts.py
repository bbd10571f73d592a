"""Is an estimated map as random as the effect that it belongs to says?"""

from __future__ import annotations

import torch
from scipy.stats import binom

from sci_lightning.diagnosis.residual_tests.frequency import spectrum
from sci_lightning.diagnosis.residual_tests.position import PLACE, block_sums
from sci_lightning.diagnosis.residual_tests.residual_test import Answer, Picture
from sci_lightning.diagnosis.residual_tests.residuals import Residuals
from sci_lightning.diagnosis.residual_tests.significance import judge

LEAST = 1e-2
"""Part of a value's variance that the captures must have told, for it to be asked."""


def chart(residuals: Residuals, name: str) -> Answer:
    """An estimated map against what it should be: independent numbers, all of one width; hot pixels strewn evenly.

    A map takes up whatever stays at its place: dust or a dead line too, which do not look like that.
    """
    values = residuals.fit.hypothesis.charts[name].double()
    known = residuals.fit.charts[name]
    if known.kind == "hot":
        return _strewn(values)
    variance = known.std**2 - known.response
    scores = torch.where(variance > LEAST * known.std**2, values / variance.clamp(min=1e-30).sqrt(), 0.0)
    height, width = scores.shape
    picture = Picture("map", scores, axes=PLACE)
    if min(height, width) == 1:
        picture = Picture(
            "curve", scores.flatten(), x=tuple(float(n) for n in range(scores.numel())), axes=(PLACE[height > width],)
        )
    answers = [judge(scores, scores.numel(), picture, dependent=True), spectrum(scores[None].float(), rings=8)]
    if min(height, width) > 1:
        total, size = block_sums(scores)
        answers.append(judge(total / size.sqrt(), scores.numel(), picture))
        answers += [judge(scores.sum(axis) / scores.shape[axis] ** 0.5, scores.numel(), picture) for axis in (0, 1)]
    first = min(answers, key=lambda answer: answer.p_value)
    return Answer(first.statistic, min(1.0, len(answers) * first.p_value), first.share, picture)


def _strewn(values: torch.Tensor) -> Answer:
    """Whether no row, column or block has more hot pixels than chance gives it."""
    hot = (values > 0).double()
    height, width = hot.shape
    number = int(hot.sum())
    total, size = block_sums(hot)
    groups = [(hot.sum(0), torch.full((width,), float(height))), (hot.sum(1), torch.full((height,), float(width)))]
    groups.append((total.flatten(), size.flatten()))
    p_values = [binom.sf(count.numpy() - 1, number, area.numpy() / hot.numel()).min() for count, area in groups]
    asked = sum(len(count) for count, _ in groups)
    most = max(float(count.max()) for count, _ in groups)
    return Answer(
        most, min(1.0, asked * float(min(p_values))), 0.0, Picture("map", values, "hot (1) or not", axes=PLACE)
    )
