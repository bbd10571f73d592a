"""The effects that a diagnosis may name: those of the package, and those of the user."""

from __future__ import annotations

from collections.abc import Mapping

from hydra.utils import get_class

from sci_lightning.encoder import effects
from sci_lightning.encoder.effects import Effect
from sci_lightning.errors import BadInput


def vocabulary(more: Mapping[str, str] | None = None) -> dict[str, type[Effect]]:
    """Every effect of the package by name, and more.

    Args:
        more: the user's own by name: dotted paths of subclasses of :class:`Effect`, ``my_module.Mine``.

    Raises:
        BadInput: a path that leads nowhere or to something that is no effect, or a name other than the effect's own.
    """
    members = [getattr(effects, each) for each in effects.__all__]
    found = {each.name: each for each in members if hasattr(each, "name")}
    for name, path in (more or {}).items():
        try:
            effect = get_class(path)
        except Exception as error:
            raise BadInput(f"candidates.{name}: no class {path!r} ({error})") from error
        if not (isinstance(effect, type) and issubclass(effect, Effect)):
            raise BadInput(f"candidates.{name}: {path} is no sci_lightning.encoder.effects.Effect")
        if effect.name != name:
            raise BadInput(f"candidates.{name}: {path} calls itself {effect.name!r}; write candidates.{effect.name}")
        found[name] = effect
    return found
