"""The diagnosis of a camera: where do captures and model disagree, and which effect is missing?

Read :mod:`sci_lightning.diagnosis.diagnosis` first: its call tree is the method. The folders depend on each other in
one direction: model, target_effects, fit, residual_tests, search, bad_captures, blind (unknown scenes), report.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
    from sci_lightning.diagnosis.search_settings import SearchSettings

__all__ = ["Diagnosis", "SearchSettings", "diagnose"]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for: commands that only check settings do not load torch."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = "search_settings" if name == "SearchSettings" else "diagnosis"
    return getattr(import_module(f"{__name__}.{module}"), name)
