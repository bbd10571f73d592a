"""Effects: named physical deviations from the ideal encoder, one a file."""

from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.exposure.flicker import Flicker
from sci_lightning.encoder.effects.exposure.rolling_shutter import RollingShutter
from sci_lightning.encoder.effects.map_effect import ChartEffect
from sci_lightning.encoder.effects.modulator.mask_contrast import MaskContrast
from sci_lightning.encoder.effects.modulator.mask_lag import MaskLag
from sci_lightning.encoder.effects.modulator.mask_level_gamma import MaskLevelGamma
from sci_lightning.encoder.effects.modulator.mask_orientation import MaskOrientation
from sci_lightning.encoder.effects.modulator.pattern_order import PatternOrder
from sci_lightning.encoder.effects.modulator.sync_offset import SyncOffset
from sci_lightning.encoder.effects.optics.optical_blur import OpticalBlur
from sci_lightning.encoder.effects.optics.veiling_glare import VeilingGlare
from sci_lightning.encoder.effects.optics.vignetting import Vignetting
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.relay.mask_blur import MaskBlur
from sci_lightning.encoder.effects.relay.mask_rotation import MaskRotation
from sci_lightning.encoder.effects.relay.mask_scale import MaskScale
from sci_lightning.encoder.effects.relay.mask_shift import MaskShift
from sci_lightning.encoder.effects.sensor.bit_depth import BitDepth
from sci_lightning.encoder.effects.sensor.black_level import BlackLevel
from sci_lightning.encoder.effects.sensor.column_noise import ColumnNoise
from sci_lightning.encoder.effects.sensor.gain import Gain
from sci_lightning.encoder.effects.sensor.hot_pixels import HotPixels
from sci_lightning.encoder.effects.sensor.prnu import Prnu
from sci_lightning.encoder.effects.sensor.read_noise import ReadNoise
from sci_lightning.encoder.effects.sensor.response_gamma import ResponseGamma
from sci_lightning.encoder.effects.sensor.row_noise import RowNoise
from sci_lightning.encoder.effects.sensor.saturation import Saturation
from sci_lightning.encoder.effects.sensor.shot_noise import ShotNoise

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
