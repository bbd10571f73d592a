"""Records made by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from sci_lightning.virtual_camera import EFFECTS, VOCABULARY

Record = dict[str, Any]


@pytest.fixture
def record() -> Callable[..., Record]:
    """``record("single", {"gain": {"factor": 1.1}}, {"gain": {"factor": (1.12, 0.01)}}, after=1.01)``."""

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
            "format": "sci-proving-ground-case",
            "format_version": 1,
            "case": f"{suite}-{'+'.join(hidden)}",
            "suite": suite,
            "mask": "structural",
            "bit_depth": 8,
            "size": [64, 64],
            "frames": 8,
            "captures": "full",
            "hidden": [
                {
                    "name": name,
                    "stage": EFFECTS[name].stage,
                    "in_vocabulary": name in VOCABULARY,
                    "parameters": values,
                    "log_likelihood_gain": nats,
                }
                for name, values in hidden.items()
            ],
            "found": [
                {
                    "name": name,
                    "parameters": {key: {"value": value, "std": std} for key, (value, std) in values.items()},
                    "alternatives": list(alternatives),
                }
                for name, values in result.items()
            ],
            "unnamed": [{"stage": stage, "where": "somewhere", "p_value": 0.0} for stage in unnamed],
            "verdict": verdict or ("explained" if result else "consistent"),
            "gap": {"before": {"chi2": before}, "after": {"chi2": after}},
            "seconds": 5.0,
            "cpu_seconds": 4.0,
            "memory_mib": 400.0,
            **more,
        }

    return made
