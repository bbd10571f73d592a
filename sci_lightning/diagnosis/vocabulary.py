"""The effects that a diagnosis may name: the camera's, the laboratory's, and those of the user."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pkgutil import resolve_name

from sci_lightning.diagnosis.target_effects import TARGET_EFFECTS
from sci_lightning.encoder import effects
from sci_lightning.encoder.effects import Effect, ReadNoise, ShotNoise
from sci_lightning.errors import BadInput

NOISE: dict[str, type[Effect]] = {effect.name: effect for effect in (ShotNoise, ReadNoise)}
"""What every camera has."""


def vocabulary(
    more: Mapping[str, str] | None = None, members: Iterable[str] = (), leave_out: Iterable[str] = ()
) -> dict[str, type[Effect]]:
    """Return every effect of the package by name, and the user's own.

    Args:
        more: the user's own by name: dotted paths of subclasses of :class:`Effect`, ``my_module.Mine``.
        members: dotted paths likewise, of the configuration group ``effect``, whose members may have any file name.
        leave_out: names of effects that are not considered.

    Raises:
        BadInput: an unknown name to be left out, or one of :data:`NOISE`.
        BadInput: a path that leads nowhere or to something that is no effect, or a name other than the effect's own.
    """
    exported = [getattr(effects, name) for name in effects.__all__]
    classes: dict[str, type[Effect]] = {effect.name: effect for effect in exported if hasattr(effect, "name")}
    classes |= TARGET_EFFECTS
    for path in members:
        effect = _effect("effect", path)
        classes[effect.name] = effect
    for name, path in (more or {}).items():
        classes[name] = _effect(f"candidates.{name}", path)
        if (own := classes[name].name) != name:
            raise BadInput(f"candidates.{name}: {path} calls itself {own!r}; write candidates.{own}")
    for name in leave_out:
        if name not in classes:
            raise BadInput(f"leave_out: no effect '{name}'; there are {', '.join(classes)}")
        if name in NOISE:
            raise BadInput(f"leave_out: every camera has {name}; it cannot be left out")
        del classes[name]
    return classes


def with_noise(classes: Mapping[str, type[Effect]]) -> dict[str, type[Effect]]:
    """Return effects by name, and those of :data:`NOISE` that are not among them."""
    return {**classes, **{name: effect for name, effect in NOISE.items() if name not in classes}}


def _effect(where: str, path: str) -> type[Effect]:
    """Import the class of an effect; ``where`` says in messages who asks for it."""
    try:
        effect = resolve_name(path)
    except Exception as error:
        raise BadInput(f"{where}: no class {path!r} ({error})") from error
    if not (isinstance(effect, type) and issubclass(effect, Effect)):
        raise BadInput(f"{where}: {path} is no sci_lightning.encoder.effects.Effect")
    return effect
