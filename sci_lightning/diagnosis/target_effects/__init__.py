"""Effects of the target: ways in which it differs from what the captures file says.

They belong to stage ``scene``, before the camera, and never become part of an encoder. One file each; this package
finds them by their files.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from sci_lightning.diagnosis.target_effects.scene_effect import SceneEffect

MODULES = sorted(path.stem for path in Path(__file__).parent.glob("scene_*.py") if path.stem != "scene_effect")


def target_effects() -> dict[str, type[SceneEffect]]:
    """Return every effect of the target by name."""
    classes = {}
    for module in MODULES:
        effect = getattr(import_module(f"{__name__}.{module}"), "".join(map(str.capitalize, module.split("_"))))
        classes[effect.name] = effect
    return classes


__all__ = ["SceneEffect", "target_effects"]
