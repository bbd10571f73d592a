"""Records made by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from sci_lightning.studies.engine import FailedCase
from sci_lightning.virtual_camera import EFFECTS, VOCABULARY

Record = dict[str, Any]
ABOUT: Record = {
    "format": "sci-proving-ground-case",
    "format_version": 1,
    "case": "single-bad",
    "digest": "0123456789abcdef",
    "suite": "single",
    "mask": "structural",
    "bit_depth": 8,
    "size": [64, 64],
    "frames": 8,
    "captures": "full",
}


def lost(**changed: str) -> FailedCase:
    """Return a case that did not come to an end; its name and what its record would say can be given."""
    about = {**ABOUT, "formulation": "overlap", **changed}
    return FailedCase(case=about["case"], about=about, failed="ValueError: no")


@pytest.fixture
def record() -> Callable[..., Record]:
    """``record("single", {"gain": {"factor": 1.1}}, {"gain": {"factor": (1.12, 0.01)}}, after=1.01)``."""

    def misfit(chi2: float) -> Record:
        return {"chi2": chi2, "rmse_dn": 1.0, "nll": 1.0, "pixels": 100, "chi2_limit": 1.05, "by_kind": {}}

    def made(
        suite: str,
        hidden: dict[str, dict[str, Any]],
        result: dict[str, dict[str, tuple[Any, float]]],
        *,
        verdict: str | None = None,
        unnamed: tuple[str, ...] = (),
        before: float = 10.0,
        after: float = 1.0,
        nats: float = 500.0,
        alternatives: tuple[str, ...] = (),
        **more: Any,
    ) -> Record:
        return {
            **ABOUT,
            "case": f"{suite}-{'+'.join(hidden)}",
            "suite": suite,
            "hidden": [
                {
                    "name": name,
                    "stage": EFFECTS[name].stage,
                    "in_vocabulary": name in VOCABULARY,
                    "parameters": values,
                    "units": dict.fromkeys(values, "1"),
                    "log_likelihood_gain": nats,
                }
                for name, values in hidden.items()
            ],
            "found": [
                {
                    "name": name,
                    "stage": "sensor",
                    "parameters": {key: {"value": v, "std": std, "unit": "1"} for key, (v, std) in values.items()},
                    "evidence": {},
                    "alternatives": list(alternatives),
                    "tell_apart": "",
                }
                for name, values in result.items()
            ],
            "unnamed": [{"stage": stage, "where": "somewhere", "p_value": 0.0, "picture": ""} for stage in unnamed],
            "verdict": verdict or ("explained" if result else "consistent"),
            "gap": {"before": misfit(before), "after": misfit(after)},
            "seconds": 5.0,
            "cpu_seconds": 4.0,
            "memory_mib": 400.0,
            **more,
        }

    return made
