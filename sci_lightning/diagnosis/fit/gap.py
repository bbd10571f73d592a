"""How far prediction and captures are apart, on pixels that no fit has seen."""

from __future__ import annotations

from typing import Any

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.likelihood import quantile_residuals
from sci_lightning.diagnosis.verdict import chi2_limit


def gap(fitter: Fitter, fit: Fit, seed: int) -> dict[str, Any]:
    """Reduced chi2 of the quantile residuals, RMSE in DN and nats per pixel: all held-out pixels, and by kind.

    With nothing held out (one capture of few pixels) the fitted pixels are taken. ``pixels`` is how many they are, and
    ``chi2_limit`` what chi2 may be by chance, see :func:`~sci_lightning.diagnosis.verdict.chi2_limit`.

    Args:
        seed: of the residuals' randomisation.
    """
    seen = fitter.model.observation
    prediction = fitter.uncertain(fit.prediction, fit.charts)
    random = torch.Generator().manual_seed(seed)
    intervals = fitter.intervals(prediction.bits)
    residual = quantile_residuals(intervals, prediction.mean, prediction.deviation, random, prediction.ceiling)
    values = fitter.values(prediction)
    error = (seen.dn - prediction.mean.clamp(0, seen.full_scale)).square()
    held = fitter.split.held if fitter.split.held.any() else fitter.split.fitted

    def over(which: torch.Tensor) -> dict[str, float]:
        return {
            "chi2": float(residual[which].square().mean()),
            "rmse_dn": float(error[which].mean().sqrt()),
            "nll": -float(values[which].mean()),
        }

    found: dict[str, Any] = over(held)
    found |= {"pixels": int(held.sum()), "chi2_limit": chi2_limit(fitter, fit, residual, held)}
    found["by_kind"] = {}
    for kind in sorted(set(seen.kinds)):
        which = held & torch.tensor([each == kind for each in seen.kinds])[:, None, None]
        if which.any():
            found["by_kind"][kind] = over(which)
    return found
