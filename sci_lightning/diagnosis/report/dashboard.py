"""A diagnosis on a dashboard such as TensorBoard: the gap as curves of two points, the figures as images."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from sci_lightning.diagnosis.fit.gap import Misfit
from sci_lightning.diagnosis.result import Result


def log_diagnosis(logger: Any, diagnosis: Result, drawn: Mapping[str, Figure]) -> None:
    """Write scalars, and figures if the logger takes them; step 0 is the ideal camera, step 1 the corrected one.

    Args:
        logger: a Lightning logger, as built from ``conf/logger``.
        diagnosis: the result.
        drawn: figures by file name.
    """
    for step, assessment in enumerate((diagnosis.before, diagnosis.after)):
        misfits: dict[str, Misfit] = {f"/{kind}": misfit for kind, misfit in assessment.gap.by_kind.items()}
        misfits[""] = assessment.gap
        scalars: dict[str, float] = {}
        for kind, misfit in misfits.items():
            scalars |= {f"{key}{kind}": getattr(misfit, key) for key in ("chi2", "rmse_dn", "nll")}
        scalars["significant_tests"] = sum(test.significant for test in assessment.tests)
        logger.log_metrics(scalars, step)
    if hasattr(logger.experiment, "add_figure"):
        for name, figure in drawn.items():
            logger.experiment.add_figure(name.removesuffix(".png"), figure, close=False)
    logger.finalize("success")
