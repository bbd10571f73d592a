"""Effects: named physical deviations from the ideal encoder, one a file."""

from sci_lightning.encoder.effects.bit_depth import BitDepth
from sci_lightning.encoder.effects.black_level import BlackLevel
from sci_lightning.encoder.effects.chart_effect import ChartEffect
from sci_lightning.encoder.effects.column_noise import ColumnNoise
from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.flicker import Flicker
from sci_lightning.encoder.effects.gain import Gain
from sci_lightning.encoder.effects.hot_pixels import HotPixels
from sci_lightning.encoder.effects.mask_blur import MaskBlur
from sci_lightning.encoder.effects.mask_contrast import MaskContrast
from sci_lightning.encoder.effects.mask_lag import MaskLag
from sci_lightning.encoder.effects.mask_level_gamma import MaskLevelGamma
from sci_lightning.encoder.effects.mask_orientation import MaskOrientation
from sci_lightning.encoder.effects.mask_rotation import MaskRotation
from sci_lightning.encoder.effects.mask_scale import MaskScale
from sci_lightning.encoder.effects.mask_shift import MaskShift
from sci_lightning.encoder.effects.optical_blur import OpticalBlur
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.pattern_order import PatternOrder
from sci_lightning.encoder.effects.prnu import Prnu
from sci_lightning.encoder.effects.read_noise import ReadNoise
from sci_lightning.encoder.effects.response_gamma import ResponseGamma
from sci_lightning.encoder.effects.rolling_shutter import RollingShutter
from sci_lightning.encoder.effects.row_noise import RowNoise
from sci_lightning.encoder.effects.saturation import Saturation
from sci_lightning.encoder.effects.shot_noise import ShotNoise
from sci_lightning.encoder.effects.sync_offset import SyncOffset
from sci_lightning.encoder.effects.veiling_glare import VeilingGlare
from sci_lightning.encoder.effects.vignetting import Vignetting

__all__ = [
    "BitDepth",
    "BlackLevel",
    "ChartEffect",
    "ColumnNoise",
    "Effect",
    "Flicker",
    "Gain",
    "HotPixels",
    "MaskBlur",
    "MaskContrast",
    "MaskLag",
    "MaskLevelGamma",
    "MaskOrientation",
    "MaskRotation",
    "MaskScale",
    "MaskShift",
    "OpticalBlur",
    "Parameter",
    "PatternOrder",
    "Prnu",
    "ReadNoise",
    "ResponseGamma",
    "RollingShutter",
    "RowNoise",
    "Saturation",
    "ShotNoise",
    "SyncOffset",
    "VeilingGlare",
    "Vignetting",
]
