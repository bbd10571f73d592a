"""A diagnosis on a dashboard: the gap as curves of two points, the pictures as images."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure


def log(logger: Any, report: Mapping[str, Any], drawn: Mapping[str, Figure]) -> None:
    """Write to a Lightning logger: scalars to any, pictures to those that take figures, as TensorBoard's does.

    Args:
        logger: as built from ``conf/logger``.
        report: ``report.json``; before is step 0, after is step 1.
        drawn: pictures by file name.
    """
    for step, when in enumerate(("before", "after")):
        gap = report["gap"][when]
        kinds = {f"/{kind}": each for kind, each in gap["by_kind"].items()} | {"": gap}
        scalars = {f"{key}{kind}": each[key] for kind, each in kinds.items() for key in ("chi2", "rmse_dn", "nll")}
        scalars["significant_tests"] = sum(each["significant"] for each in report["where"][when])
        logger.log_metrics(scalars, step)
    if hasattr(logger.experiment, "add_figure"):
        for name, figure in drawn.items():
            logger.experiment.add_figure(name.removesuffix(".png"), figure, close=False)
    logger.finalize("success")
