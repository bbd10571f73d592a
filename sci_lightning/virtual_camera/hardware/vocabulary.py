"""The list of every effect that can be hidden, in the order in which the light meets them."""

from __future__ import annotations

from sci_lightning.virtual_camera.hardware import (
    converter,
    exposure,
    fixed_pattern,
    laboratory,
    modulator,
    optics,
    relay,
    sensor,
)
from sci_lightning.virtual_camera.hardware.effect import Effect

LIGHT_PATH: tuple[type[Effect], ...] = (
    laboratory.MislabelledCaptures,
    laboratory.MovedCapture,
    laboratory.DroppedSlot,
    laboratory.SceneGamma,
    laboratory.SceneBlur,
    laboratory.SceneScale,
    laboratory.SceneRotation,
    laboratory.SceneShift,
    modulator.MirrorHysteresis,
    modulator.SwappedPatterns,
    modulator.PatternOrder,
    modulator.MaskOrientation,
    modulator.MaskLevelGamma,
    modulator.MaskContrast,
    modulator.StuckMirrors,
    modulator.ModulatorDust,
    modulator.MaskLag,
    modulator.SyncOffset,
    relay.MaskShift,
    relay.MaskRotation,
    relay.MaskScale,
    relay.MaskKeystone,
    relay.MaskDistortion,
    relay.MaskBlur,
    relay.MaskAstigmatism,
    relay.MaskDrift,
    exposure.DriftingSource,
    exposure.UnsteadySource,
    exposure.Flicker,
    exposure.DutyCycle,
    exposure.ShortSlot,
    exposure.UnevenSlots,
    exposure.RollingShutter,
    optics.Ghost,
    optics.OpticalBlur,
    optics.Astigmatism,
    optics.Vignetting,
    optics.Illumination,
    optics.VeilingGlare,
    optics.Flare,
    optics.EtalonFringes,
    optics.LightLeak,
    optics.DoorLeak,
    fixed_pattern.SensorDust,
    sensor.ImageLag,
    sensor.Gain,
    fixed_pattern.Prnu,
    fixed_pattern.InterlacedGain,
    fixed_pattern.DeadColumn,
    sensor.BrighterFatter,
    converter.ShotNoise,
    sensor.InterPixelCapacitance,
    sensor.Saturation,
    sensor.ResponseGamma,
    sensor.SShapedResponse,
    sensor.BlackLevel,
    fixed_pattern.ColumnNoise,
    fixed_pattern.RowNoise,
    fixed_pattern.HotPixels,
    sensor.RowFlutter,
    sensor.Banding,
    converter.ReadNoise,
    converter.ConverterStep,
    converter.DifferentialNonlinearity,
    converter.BitDepth,
)

_OTHER_FIELDS: tuple[type[Effect], ...] = (
    sensor.BrighterFatter,
    optics.EtalonFringes,
    sensor.InterPixelCapacitance,
    converter.DifferentialNonlinearity,
    modulator.MirrorHysteresis,
    optics.DoorLeak,
    relay.MaskDrift,
    laboratory.MislabelledCaptures,
    laboratory.MovedCapture,
    laboratory.DroppedSlot,
)
EFFECTS: dict[str, type[Effect]] = {effect.name: effect for effect in LIGHT_PATH}

_OUTSIDE: tuple[type[Effect], ...] = (
    modulator.SwappedPatterns,
    modulator.StuckMirrors,
    modulator.ModulatorDust,
    relay.MaskAstigmatism,
    exposure.DriftingSource,
    exposure.UnsteadySource,
    exposure.ShortSlot,
    exposure.UnevenSlots,
    optics.Ghost,
    optics.Astigmatism,
    optics.Flare,
    optics.LightLeak,
    fixed_pattern.SensorDust,
    fixed_pattern.InterlacedGain,
    fixed_pattern.DeadColumn,
    sensor.ImageLag,
    sensor.SShapedResponse,
    sensor.RowFlutter,
    sensor.Banding,
    converter.ConverterStep,
    *_OTHER_FIELDS,
)

OUTSIDE: dict[str, type[Effect]] = {effect.name: effect for effect in _OUTSIDE}
"""Effects for which a diagnosis has no name: it should report the stage at which they act, and no other effect."""

OTHER_FIELDS: dict[str, type[Effect]] = {effect.name: effect for effect in _OTHER_FIELDS}
"""Those of them from the calibration of other instruments, chosen before any diagnosis had seen them."""

VOCABULARY = {name: effect for name, effect in EFFECTS.items() if name not in OUTSIDE}
"""The effects that a diagnosis can name."""
