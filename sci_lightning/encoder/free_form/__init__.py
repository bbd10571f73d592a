"""Free-form deviations: they show at which stage something is missing that no named effect explains."""

from sci_lightning.encoder.free_form.free_form import FreeForm
from sci_lightning.encoder.free_form.light import (
    CarryOver,
    ColumnGain,
    Ghost,
    ImageTaps,
    OffsetMap,
    ResponseCurve,
    RowGain,
    Shading,
    SlotWeights,
    SourcePower,
    StrayLight,
)
from sci_lightning.encoder.free_form.mask import LeakMap, LevelCurve, MaskField, MaskTaps, PatternMixing

__all__ = [
    "CarryOver",
    "ColumnGain",
    "FreeForm",
    "Ghost",
    "ImageTaps",
    "LeakMap",
    "LevelCurve",
    "MaskField",
    "MaskTaps",
    "OffsetMap",
    "PatternMixing",
    "ResponseCurve",
    "RowGain",
    "Shading",
    "SlotWeights",
    "SourcePower",
    "StrayLight",
]
