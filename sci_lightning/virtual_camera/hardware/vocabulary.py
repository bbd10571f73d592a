"""Every effect that can be hidden, in the order in which light meets them."""

from __future__ import annotations

from sci_lightning.virtual_camera.hardware import (
    converter,
    distortion,
    exposure,
    fixed_pattern,
    image_lag,
    modulator,
    optics,
    pickup,
    relay,
    response,
)
from sci_lightning.virtual_camera.hardware.effect import Effect

LIGHT_PATH: tuple[type[Effect], ...] = (
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
    relay.MaskBlur,
    distortion.Keystone,
    distortion.BarrelDistortion,
    distortion.MaskAstigmatism,
    exposure.DriftingSource,
    exposure.UnsteadySource,
    exposure.Flicker,
    exposure.ShortSlot,
    exposure.UnevenSlots,
    exposure.RollingShutter,
    optics.Ghost,
    optics.OpticalBlur,
    optics.Astigmatism,
    optics.Vignetting,
    optics.VeilingGlare,
    optics.Flare,
    optics.LightLeak,
    fixed_pattern.SensorDust,
    image_lag.ImageLag,
    response.Gain,
    fixed_pattern.Prnu,
    fixed_pattern.InterlacedGain,
    fixed_pattern.DeadColumn,
    converter.ShotNoise,
    response.Saturation,
    response.ResponseGamma,
    response.SShapedResponse,
    response.BlackLevel,
    fixed_pattern.ColumnNoise,
    fixed_pattern.RowNoise,
    fixed_pattern.HotPixels,
    pickup.RowFlutter,
    pickup.Banding,
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
        distortion.Keystone,
        distortion.BarrelDistortion,
        distortion.MaskAstigmatism,
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
        image_lag.ImageLag,
        response.SShapedResponse,
        pickup.RowFlutter,
        pickup.Banding,
        converter.ConverterStep,
    )
}
"""Effects that a diagnosis has no name for: it should say where they sit, and must not call them something else."""

VOCABULARY = {name: effect for name, effect in EFFECTS.items() if name not in OUTSIDE}
"""The effects that a diagnosis can name."""
