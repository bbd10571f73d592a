"""What snapshots of unknown scenes cannot tell from something about the scenes."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.blind.prior import LONGEST_VIDEO
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.target_effects import SceneEffect
from sci_lightning.encoder.effects import Effect, OpticsEffect, SensorEffect

UNDETERMINED = {
    "gain": "the brightness of the scenes",
    "duty_cycle": "the brightness of the scenes",
    "vignetting": "scenes that are darker towards the corners",
    "illumination": "scenes that are lit unevenly",
    "field_blur": "scenes that are less sharp towards the corners",
    "bit_planes": "scenes that move otherwise within the slots",
    "saturation": "the brightest parts of the scenes; saturated pixels are left out",
}
"""Effects that snapshots of unknown scenes cannot tell from something about the scenes."""
SHOWN_IF_STRONG = {
    "mask_lag": "scenes that move a little less; if strong it may be named",
    "sync_offset": "scenes that move a little less; if strong it may be named",
}
"""Effects that mix a slot with its neighbour. A scene that moves less looks so too, but for the first slot, which no
motion mixes with the last one (docs/results/blind-mixed-slots.json says how strong an effect must be for that)."""
OF_THE_OPTICS = "a blur of the mask, and scenes that are less sharp or have less contrast"
"""What effects of the optics look like where patches of many slots are too large for light from around them."""
OF_THE_SLOTS = "scenes that are brighter in some slots, such as those of a spectral camera"
"""What flicker looks like there."""
OF_THE_SENSOR = "scenes of another distribution of brightness"
"""What a response of the sensor looks like where scenes are only assumed to be smooth."""


def slower_scenes(effect: type[Effect]) -> type[Effect]:
    """Return an effect that does to snapshots what a scene does that moves less, in the place of a mixture of slots.

    A pattern that stays on during the next slot sees the mean of two frames. Here it does so without the circle, which
    mixes the first slot with the last one, and without the difference in brightness that a lag makes between slots.

    Args:
        effect: of the modulator, which mixes slots.
    """

    class SlowerScenes(effect):  # type: ignore[valid-type, misc]
        def schedule(self, slots: int) -> torch.Tensor:
            slot = torch.arange(slots)
            neighbours = (slot[:, None] - slot).abs() <= slots / 2
            mixture = super().schedule(slots) * neighbours
            return mixture / mixture.sum(0)

    return SlowerScenes


def undetermined_effects(model: CameraModel) -> dict[str, str]:
    """Return the effects that the snapshots cannot tell from something about the scenes, and from what."""
    unclear = {name: why for name, why in UNDETERMINED.items() if name in model.vocabulary}
    if model.observation.frames > LONGEST_VIDEO:
        for name, effect in model.vocabulary.items():
            if issubclass(effect, OpticsEffect):
                unclear.setdefault(name, OF_THE_OPTICS)
            elif issubclass(effect, SensorEffect) and not (effect.noise or effect.map_kind):
                unclear.setdefault(name, OF_THE_SENSOR)
        if "flicker" in model.vocabulary:
            unclear["flicker"] = OF_THE_SLOTS
    return unclear


def determined_effects(model: CameraModel) -> dict[str, type[Effect]]:
    """Return the effects that a search in snapshots of unknown scenes considers, by name."""
    undetermined = undetermined_effects(model)
    return {
        name: effect
        for name, effect in model.vocabulary.items()
        if not (effect.noise or effect.map_kind or effect.imperfection or issubclass(effect, SceneEffect))
        and name not in undetermined
        and not (issubclass(effect, SensorEffect) and effect.is_discrete())
    }
