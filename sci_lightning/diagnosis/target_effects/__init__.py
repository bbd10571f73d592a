"""Effects of the target: ways in which it differs from what the captures file says.

They belong to stage ``scene``, before the camera, and never become part of an encoder.
"""

from sci_lightning.diagnosis.target_effects.scene_blur import SceneBlur
from sci_lightning.diagnosis.target_effects.scene_detail import SceneDetail
from sci_lightning.diagnosis.target_effects.scene_effect import SceneEffect, changed_scenes
from sci_lightning.diagnosis.target_effects.scene_gamma import SceneGamma
from sci_lightning.diagnosis.target_effects.scene_rotation import SceneRotation
from sci_lightning.diagnosis.target_effects.scene_scale import SceneScale
from sci_lightning.diagnosis.target_effects.scene_shift import SceneShift

TARGET_EFFECTS: dict[str, type[SceneEffect]] = {
    effect.name: effect for effect in (SceneBlur, SceneDetail, SceneGamma, SceneRotation, SceneScale, SceneShift)
}
"""Every effect of the target by name."""

__all__ = ["TARGET_EFFECTS", "SceneDetail", "SceneEffect", "changed_scenes"]
