"""The light's way through all effects, stage by stage."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

import torch
from torch import nn

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.stage import (
    STAGES,
    ExposureEffect,
    ModulatorEffect,
    OpticsEffect,
    RelayEffect,
    SensorEffect,
)
from sci_lightning.encoder.exposure import Exposure
from sci_lightning.encoder.modulator_grid import ModulatorGrid
from sci_lightning.encoder.relay import RelayGeometry
from sci_lightning.encoder.signal import Signal
from sci_lightning.errors import BadInput

CELLS = 5
"""Cells per pixel and axis for a displaced mask behind a blurred lens."""
DETAIL_CELLS = 3
"""The same for a scene that changes within a pixel, behind either of them."""

StageEffect = TypeVar("StageEffect", ModulatorEffect, RelayEffect, ExposureEffect, OpticsEffect, SensorEffect)


class LightPath(nn.Module):
    """Effects in the order in which light meets them, whatever the order in which they are given.

    Checkpoints name the parameters by effect (``effects.mask_shift.dx``), so that they do not depend on which other
    effects there are, nor on ranks.

    Args:
        effects: effects of any stage, each name at most once.
        grid: where the mirrors nominally lie in the field; None where every mirror is a pixel.
        detailed: whether the scene changes within a pixel.

    Raises:
        BadInput: a name twice or one that cannot be a key, or something that is not an effect of one of the stages.
    """

    def __init__(
        self, effects: Iterable[Effect] = (), grid: ModulatorGrid | None = None, detailed: bool = False
    ) -> None:
        super().__init__()
        self.grid, self.detailed = grid, detailed
        given = list(effects)
        for effect in given:
            if not isinstance(effect, Effect):
                raise BadInput(f"effects must be effects of the encoder, got {type(effect).__name__}")
            if not isinstance(effect, tuple(STAGES.values())):
                raise BadInput(
                    f"effect {effect.name}: {type(effect).__name__} derives from Effect alone; derive it from the base "
                    f"class of its stage: {', '.join(base.__name__ for base in STAGES.values())}"
                )
            if not effect.name.isidentifier() or hasattr(nn.ModuleDict, effect.name):
                raise BadInput(f"effect {effect.name!r}: this name cannot be used, as keys of parameters contain it")
        names = [effect.name for effect in given]
        for name in names:
            if names.count(name) > 1:
                raise BadInput(f"effect {name} is given {names.count(name)} times; once is enough")
        given.sort(key=lambda effect: effect.rank)
        self.effects = nn.ModuleDict({effect.name: effect for effect in given})

    @property
    def names(self) -> list[str]:
        """The effects' names, in order."""
        return list(self.effects)

    @property
    def cells(self) -> int:
        """The number of cells along either axis of a pixel: above 1 where it matters where in a pixel the light falls.

        A displaced mask makes the light of a pixel uneven, and so does a scene with detail; a blur sees either. Where
        both do, their product is not that of their means.
        """
        displaced = self.grid is not None or bool(self.of(RelayEffect))
        blurred = any(effect.subpixel for effect in self.of(OpticsEffect))
        if displaced and blurred:
            return CELLS
        return DETAIL_CELLS if self.detailed and (displaced or blurred) else 1

    def border(self, size: tuple[int, int]) -> Border:
        """Return how far what lies beyond a field of ``size`` (H, W) reaches into it through all effects together.

        What lies beyond the field may still be on a modulator with a grid of its own, and is then known.
        """
        effects = [effect for effect in self.effects.values() if isinstance(effect, Effect)]
        if self.grid is None:
            return sum((effect.border(size) for effect in effects), Border())
        aimed = [relay for relay in self.of(RelayEffect) if type(relay).aim is not RelayEffect.aim]
        others = (effect.border(size) for effect in effects if effect not in aimed)
        return sum(others, self.geometry.border(self.grid))

    @property
    def geometry(self) -> RelayGeometry:
        """Where the mask's image lies and how sharp it is."""
        geometry = RelayGeometry()
        for relay in self.of(RelayEffect):
            geometry = relay.aim(geometry)
        return geometry

    def of(self, stage: type[StageEffect]) -> list[StageEffect]:
        """Return the effects of one stage, named by its base class, in order."""
        return [effect for effect in self.effects.values() if isinstance(effect, stage)]

    @property
    def retiming(self) -> list[ExposureEffect]:
        """The effects that display a part of the patterns at another time within its slot."""
        return [effect for effect in self.of(ExposureEffect) if type(effect).retimed is not ExposureEffect.retimed]

    @property
    def imaging(self) -> list[Effect]:
        """The effects on which :meth:`images` depends."""
        return [*self.of(ModulatorEffect), *self.of(RelayEffect), *self.retiming]

    @property
    def shows_patterns_as_commanded(self) -> bool:
        """Whether no effect comes between a commanded pattern and what multiplies the frame."""
        between = (ModulatorEffect, RelayEffect, ExposureEffect)
        return self.grid is None and not any(isinstance(effect, between) for effect in self.effects.values())

    def images(self, patterns: torch.Tensor, wanted: torch.Tensor | None = None) -> torch.Tensor:
        """Modulator and relay: return the images ``(P, qH, qW)`` on the sensor of commanded patterns ``(P, H, W)``.

        Patterns on a grid of their own are ``(P, Hm, Wm)``. Free-form deviations of the relay are then applied to their
        nominal image, because they are in pixels. The images of :meth:`.ExposureEffect.retimed` follow, P for every one
        of :attr:`retiming`.

        Args:
            patterns: as commanded.
            wanted: ``(qH, qW)`` bool, the cells that are asked for, see :meth:`.RelayGeometry.image`; None for all.
        """
        own = self._image(patterns, wanted)
        others = [self._image(effect.retimed(patterns), wanted) for effect in self.retiming]
        return torch.cat((own, *others)) if others else own

    def _image(self, patterns: torch.Tensor, wanted: torch.Tensor | None) -> torch.Tensor:
        for effect in self.of(ModulatorEffect):
            patterns = effect.show(patterns)
        if self.grid is not None:
            patterns = self.geometry.image(patterns, self.cells, self.grid)
        for relay in self.of(RelayEffect):
            patterns = relay.show(patterns) if self.grid is None else relay.show(patterns, self.cells)
        return self.geometry.image(patterns, self.cells, wanted=wanted) if self.grid is None else patterns

    def transmittance(self, patterns: torch.Tensor, sequence: torch.Tensor | None = None) -> torch.Tensor:
        """Modulator, relay and exposure: return what multiplies each frame of the scene.

        Args:
            patterns: ``(P, H, W)`` commanded patterns, ``(P, Hm, Wm)`` on a grid of their own.
            sequence: ``(U, T)`` index of the pattern commanded for each slot; None for 0 to P - 1.

        Returns:
            ``(U, T, qH, qW)`` for pixels of q x q :attr:`cells`; ``(T, qH, qW)`` without a sequence.
        """
        shown = self.during(self.images(patterns), sequence)
        return shown[0] if sequence is None else shown

    def during(self, images: torch.Tensor, sequence: torch.Tensor | None = None) -> torch.Tensor:
        """Schedule and exposure: return ``(U, T, qH, qW)``, what multiplies each frame, from :meth:`images`."""
        by_part = images.unflatten(0, (1 + len(self.retiming), -1))
        parts = by_part[:, None] if sequence is None else by_part[:, sequence]  # (parts, U, T, qH, qW)
        slots, mixture = parts.shape[2], self._mixture(parts.shape[2], images)
        shown = parts[0] if mixture is None else torch.einsum("pts,pushw->uthw", mixture, parts)
        if timed := [effect for effect in self.of(ExposureEffect) if type(effect).expose is not ExposureEffect.expose]:
            exposure = Exposure.ideal(slots, images.shape[-2] // self.cells, shown)
            for timing in timed:
                exposure = timing.expose(exposure)
            shown = exposure.mask(shown)
        return shown

    def _mixture(self, slots: int, like: torch.Tensor) -> torch.Tensor | None:
        """Return how much of every part of slot s's pattern multiplies frame t, ``(parts, T, T)``; None for its own."""
        schedules = [effect.schedule(slots) for effect in self.of(ModulatorEffect)]
        own = torch.eye(slots).to(like)
        for schedule in schedules:
            own = own if schedule is None else schedule.to(like) @ own
        if not self.retiming:
            return None if all(schedule is None for schedule in schedules) else own[None]
        others = torch.stack([effect.retiming(slots).to(like) for effect in self.retiming]) @ own
        return torch.cat(((own - others.sum(0))[None], others))

    def form(self, signal: Signal) -> Signal:
        """Optics: return the image on the sensor's pixels of the modulated light, which may be given in cells."""
        passed: list[ExposureEffect | OpticsEffect] = [*self.of(ExposureEffect), *self.of(OpticsEffect)]
        for effect in passed:
            signal = effect.form(signal)
        return signal.pooled()

    def respond(self, signal: Signal) -> Signal:
        """Sensor: return mean and variance before the converter."""
        for effect in self.of(SensorEffect):
            signal = effect.respond(signal)
        return signal

    def effective_bits(self, bits: int) -> int:
        """Return how many of the converter's bits count."""
        for effect in self.of(SensorEffect):
            bits = effect.effective_bits(bits)
        return bits
