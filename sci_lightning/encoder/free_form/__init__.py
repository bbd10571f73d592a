"""Free-form deviations: they show at which stage something is missing that no named effect explains."""

from sci_lightning.encoder.free_form.carry_over import CarryOver
from sci_lightning.encoder.free_form.column_gain import ColumnGain
from sci_lightning.encoder.free_form.free_form import Empirical
from sci_lightning.encoder.free_form.ghost import Ghost
from sci_lightning.encoder.free_form.image_taps import ImageTaps
from sci_lightning.encoder.free_form.leak_map import LeakMap
from sci_lightning.encoder.free_form.level_curve import LevelCurve
from sci_lightning.encoder.free_form.mask_field import MaskField
from sci_lightning.encoder.free_form.mask_taps import MaskTaps
from sci_lightning.encoder.free_form.offset_map import OffsetMap
from sci_lightning.encoder.free_form.pattern_mixing import PatternMixing
from sci_lightning.encoder.free_form.response_curve import ResponseCurve
from sci_lightning.encoder.free_form.row_gain import RowGain
from sci_lightning.encoder.free_form.shading import Shading
from sci_lightning.encoder.free_form.slot_weights import SlotWeights
from sci_lightning.encoder.free_form.source_power import SourcePower
from sci_lightning.encoder.free_form.stray_light import StrayLight

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
