"""Free-form deviations with as many numbers as captures can determine."""

from __future__ import annotations

from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.encoder import free_form
from sci_lightning.encoder.effects import Effect, ModulatorEffect
from sci_lightning.encoder.free_form import FreeForm


def free_forms_for(observation: Observation) -> dict[str, type[Effect]]:
    """Return every free-form deviation by name, with as many numbers as these captures can determine."""
    classes = [getattr(free_form, name) for name in free_form.__all__ if name != "FreeForm"]
    if observation.grid is not None:  # a map of the mirrors is not one of the pixels
        classes = [one for one in classes if not (one.map_kind and issubclass(one, ModulatorEffect))]
    captures, frames = len(observation), observation.frames
    return {one.name: one.of(one.numbers(captures, frames)) if issubclass(one, FreeForm) else one for one in classes}
