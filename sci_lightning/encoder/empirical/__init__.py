"""Free-form deviations: they show at which stage something is missing that no named effect explains."""

from sci_lightning.encoder.empirical.carry_over import CarryOver
from sci_lightning.encoder.empirical.column_gain import ColumnGain
from sci_lightning.encoder.empirical.empirical import Empirical
from sci_lightning.encoder.empirical.ghost import Ghost
from sci_lightning.encoder.empirical.image_taps import ImageTaps
from sci_lightning.encoder.empirical.leak_map import LeakMap
from sci_lightning.encoder.empirical.level_curve import LevelCurve
from sci_lightning.encoder.empirical.mask_field import MaskField
from sci_lightning.encoder.empirical.mask_taps import MaskTaps
from sci_lightning.encoder.empirical.offset_map import OffsetMap
from sci_lightning.encoder.empirical.pattern_mixing import PatternMixing
from sci_lightning.encoder.empirical.response_curve import ResponseCurve
from sci_lightning.encoder.empirical.row_gain import RowGain
from sci_lightning.encoder.empirical.shading import Shading
from sci_lightning.encoder.empirical.slot_weights import SlotWeights
from sci_lightning.encoder.empirical.source_power import SourcePower
from sci_lightning.encoder.empirical.stray_light import StrayLight

__all__ = [
    "CarryOver",
    "ColumnGain",
    "Empirical",
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
