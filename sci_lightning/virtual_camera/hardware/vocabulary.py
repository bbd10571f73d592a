"""The list of every effect that can be hidden, in the order in which the light meets them."""

from __future__ import annotations

from sci_lightning.virtual_camera.hardware import (
    converter,
    exposure,
    fixed_pattern,
    modulator,
    optics,
    relay_effects,
    sensor,
    target,
)
from sci_lightning.virtual_camera.hardware.effect import Effect

LIGHT_PATH: tuple[type[Effect], ...] = (
    target.SceneGamma,
    target.SceneBlur,
    target.SceneScale,
    target.SceneRotation,
    target.SceneShift,
    modulator.SwappedPatterns,
    modulator.PatternOrder,
    modulator.MaskOrientation,
    modulator.MaskLevelGamma,
    modulator.MaskContrast,
    modulator.StuckMirrors,
    modulator.ModulatorDust,
    modulator.MaskLag,
    modulator.SyncOffset,
    relay_effects.MaskShift,
    relay_effects.MaskRotation,
    relay_effects.MaskScale,
    relay_effects.MaskKeystone,
    relay_effects.MaskDistortion,
    relay_effects.MaskBlur,
    relay_effects.MaskAstigmatism,
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
    optics.LightLeak,
    fixed_pattern.SensorDust,
    sensor.ImageLag,
    sensor.Gain,
    fixed_pattern.Prnu,
    fixed_pattern.InterlacedGain,
    fixed_pattern.DeadColumn,
    converter.ShotNoise,
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
    converter.BitDepth,
)

EFFECTS: dict[str, type[Effect]] = {effect.name: effect for effect in LIGHT_PATH}

OUTSIDE: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        modulator.SwappedPatterns,
        modulator.StuckMirrors,
        modulator.ModulatorDust,
        relay_effects.MaskAstigmatism,
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
    )
}
"""Effects for which a diagnosis has no name: it should report the stage at which they act, and no other effect."""

VOCABULARY = {name: effect for name, effect in EFFECTS.items() if name not in OUTSIDE}
"""The effects that a diagnosis can name."""
