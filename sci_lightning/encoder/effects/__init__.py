"""Effects: named physical deviations from the ideal encoder, one file each, in a folder for each stage.

A new effect is one file ``<stage>/<name>.py`` with one class, such as ``relay/mask_shift.py`` with ``MaskShift``, and
one file ``conf/effect/<name>.yaml`` that names it and gives its values; then commands take ``effect=<name>`` and every
diagnosis of known scenes considers it without any list; what snapshots of unknown scenes cannot tell it from stands in
:mod:`sci_lightning.diagnosis.blind.undetermined`. This package finds its effects by their files, and
``from sci_lightning.encoder.effects import MaskShift`` loads the file when the name is used. An effect outside of this
package is used the same way, by the path of its class: ``_target_: my_module.MyEffect``.

The class derives from the base class of its stage (:mod:`~sci_lightning.encoder.effects.stage` has their formulas), and
from :class:`MapEffect` as well if every pixel, row or column has a value of its own.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.map_effect import FixedPatternGain, FixedPatternOffset, MapEffect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import (
    STAGES,
    ExposureEffect,
    ModulatorEffect,
    OpticsEffect,
    RelayEffect,
    SensorEffect,
)

FILES = {
    "".join(word.capitalize() for word in path.stem.split("_")): f"{__name__}.{stage}.{path.stem}"
    for stage in STAGES
    for path in sorted((Path(__file__).parent / stage).glob("[a-z]*.py"))
}
"""The module of every effect's class, by the name of the class: ``MaskShift`` is in ``relay.mask_shift``."""

__all__ = [
    "Effect",
    "ExposureEffect",
    "FixedPatternGain",
    "FixedPatternOffset",
    "MapEffect",
    "ModulatorEffect",
    "OpticsEffect",
    "Parameter",
    "RelayEffect",
    "SensorEffect",
]
__all__ += sorted(FILES)


def __getattr__(name: str) -> Any:
    """Load the class of an effect when it is first used (PEP 562)."""
    if name not in FILES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    effect = getattr(import_module(FILES[name]), name)
    globals()[name] = effect
    return effect


def __dir__() -> list[str]:
    return sorted(__all__)
