"""Free-form deviations: they show at which stage something is missing that no named effect explains."""

from sci_lightning.encoder.free_form.exposure import SlotWeights, SourcePower
from sci_lightning.encoder.free_form.free_form import FreeForm
from sci_lightning.encoder.free_form.modulator import LeakMap, LevelCurve, PatternMixing
from sci_lightning.encoder.free_form.optics import Ghost, ImageTaps, Shading, StrayLight
from sci_lightning.encoder.free_form.relay import MaskField, MaskTaps
from sci_lightning.encoder.free_form.sensor import CarryOver, ColumnGain, OffsetMap, ResponseCurve, RowGain

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
