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

LIGHT_PATH = {
    "capture": "mislabelled_captures moved_capture dropped_slot",
    "scene": "scene_gamma scene_blur scene_scale scene_rotation scene_shift",
    "modulator": (
        "mirror_hysteresis swapped_patterns pattern_order mask_orientation mask_level_gamma mask_contrast "
        "stuck_mirrors modulator_dust mask_lag sync_offset"
    ),
    "relay": (
        "mask_shift mask_rotation mask_scale lateral_colour mask_keystone mask_distortion mask_blur mask_astigmatism "
        "mask_drift"
    ),
    "exposure": (
        "drifting_source unsteady_source flicker duty_cycle short_slot uneven_slots rolling_shutter phased_reset "
        "bit_planes"
    ),
    "optics": (
        "ghost optical_blur field_blur astigmatism vignetting illumination veiling_glare flare etalon_fringes "
        "light_leak door_leak sensor_dust"
    ),
    "sensor": (
        "image_lag gain prnu interlaced_gain dead_column brighter_fatter shot_noise inter_pixel_capacitance saturation "
        "response_gamma s_shaped_response black_level column_noise row_noise hot_pixels row_flutter banding read_noise "
        "converter_step differential_nonlinearity bit_depth"
    ),
}
"""The names of all effects, stage by stage."""
_MODULES = (laboratory, modulator, relay, exposure, optics, fixed_pattern, sensor, converter)
_CLASSES = {
    effect.name: effect
    for module in _MODULES
    for effect in vars(module).values()
    if isinstance(effect, type) and issubclass(effect, Effect) and hasattr(effect, "name")
}


def _named(names: str) -> dict[str, type[Effect]]:
    """Return effects by their names, which stand in one text."""
    return {name: _CLASSES[name] for name in names.split()}


EFFECTS = _named(" ".join(LIGHT_PATH.values()))

OTHER_FIELDS = _named(
    "brighter_fatter etalon_fringes inter_pixel_capacitance differential_nonlinearity mirror_hysteresis door_leak "
    "mask_drift mislabelled_captures moved_capture dropped_slot"
)
"""Effects from the calibration of other instruments, chosen before any diagnosis had seen them."""

OUTSIDE = {
    **_named(
        "swapped_patterns stuck_mirrors modulator_dust mask_astigmatism drifting_source unsteady_source short_slot "
        "uneven_slots ghost astigmatism flare light_leak sensor_dust interlaced_gain dead_column image_lag "
        "s_shaped_response row_flutter banding converter_step"
    ),
    **OTHER_FIELDS,
}
"""Effects for which a diagnosis has no name: it should report the stage at which they act, and no other effect."""

VOCABULARY = {name: effect for name, effect in EFFECTS.items() if name not in OUTSIDE}
"""The effects that a diagnosis can name."""

LATER = _named("lateral_colour phased_reset bit_planes field_blur")
"""Those of them that came after the first records: seeds do not draw them, so that what they draw stays the same."""

DRAWN = {name: effect for name, effect in VOCABULARY.items() if name not in LATER}
"""Those of which seeds draw."""
