"""Classes whose module has moved since version 0.1.0: files and checkpoints of that version still name the old one."""

from __future__ import annotations

from collections.abc import Mapping

MOVED: Mapping[str, str] = {
    "sci_lightning.system.System": "sci_lightning.training.system.System",
    "sci_lightning.denoiser_system.DenoiserSystem": "sci_lightning.training.denoiser_system.DenoiserSystem",
    "sci_lightning.data.Benchmark": "sci_lightning.data.SixScenes",
    "sci_lightning.data.benchmark.Benchmark": "sci_lightning.data.SixScenes",
}
"""Present names by former ones, of classes that are configured outside of encoder and decoder.

Those of encoders and decoders are found by the name under which their package exports them, see
:mod:`sci_lightning.configuration.registry`.
"""


def present_name(target: object) -> object:
    """Return the present dotted name of a class that a file names; anything else is returned as it is."""
    return MOVED.get(target, target) if isinstance(target, str) else target
