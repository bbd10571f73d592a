"""The light's way through all effects, stage by stage."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import nn

from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.exposure import Exposure
from sci_lightning.encoder.relay import Pose
from sci_lightning.encoder.signal import Signal
from sci_lightning.errors import BadInput

CELLS = 5
"""Cells per pixel and axis for a displaced mask behind a blurred lens."""


class LightPath(nn.Module):
    """Effects in the order in which light meets them, whatever the order they are given in.

    Args:
        effects: any, each name at most once.

    Raises:
        BadInput: a name twice, or something that is no effect.
    """

    def __init__(self, effects: Iterable[Effect] = ()) -> None:
        super().__init__()
        given = list(effects)
        for effect in given:
            if not isinstance(effect, Effect):
                raise BadInput(f"effects must be effects of the encoder, got {type(effect).__name__}")
        names = [effect.name for effect in given]
        for name in names:
            if names.count(name) > 1:
                raise BadInput(f"effect {name} is given {names.count(name)} times; once is enough")
        given.sort(key=lambda effect: effect.rank)
        self.effects = nn.ModuleList(given)

    @property
    def names(self) -> list[str]:
        """The effects' names, in order."""
        return [effect.name for effect in self.effects]  # type: ignore[misc]

    @property
    def cells(self) -> int:
        """Into how many cells a pixel is cut along either axis, so that a blur knows where in it the light falls."""
        return CELLS if self.of("relay") and any(effect.subpixel for effect in self.of("optics")) else 1

    def of(self, stage: str) -> list[Effect]:
        """The effects of one stage, in order."""
        return [effect for effect in self.effects if effect.stage == stage]  # type: ignore[misc]

    def images(self, patterns: torch.Tensor) -> torch.Tensor:
        """Modulator and relay: patterns told to the modulator ``(P, H, W)`` to images on the sensor ``(P, qH, qW)``."""
        for effect in (*self.of("modulator"), *self.of("relay")):
            patterns = effect.show(patterns)
        pose = Pose()
        for effect in self.of("relay"):
            pose = effect.aim(pose)
        return pose.image(patterns, self.cells)

    def transmittance(self, patterns: torch.Tensor, sequence: torch.Tensor | None = None) -> torch.Tensor:
        """Modulator, relay and exposure: what each frame of the scene is multiplied with.

        Args:
            patterns: ``(P, H, W)`` told to the modulator.
            sequence: ``(U, T)`` which pattern was told for each slot; None for 0 to P - 1.

        Returns:
            ``(U, T, qH, qW)`` for pixels of q x q :attr:`cells`; ``(T, qH, qW)`` without a sequence.
        """
        shown = self.during(self.images(patterns), sequence)
        return shown[0] if sequence is None else shown

    def during(self, images: torch.Tensor, sequence: torch.Tensor | None = None) -> torch.Tensor:
        """Schedule and exposure: ``(U, T, qH, qW)`` what each frame is multiplied with, of :meth:`images`."""
        shown = images[None] if sequence is None else images[sequence]
        slots = shown.shape[1]
        for effect in self.of("modulator"):
            if (mixture := effect.schedule(slots)) is not None:
                shown = torch.einsum("ts,ushw->uthw", mixture.to(shown), shown)
        if timed := self.of("exposure"):
            exposure = Exposure.ideal(slots, images.shape[-2] // self.cells, shown)
            for effect in timed:
                exposure = effect.expose(exposure)
            shown = exposure.mask(shown)
        return shown

    def form(self, signal: Signal) -> Signal:
        """Optics: the modulated image, in cells if need be, to the image on the sensor's pixels."""
        for effect in (*self.of("exposure"), *self.of("optics")):
            signal = effect.form(signal)
        return signal.pooled()

    def respond(self, signal: Signal) -> Signal:
        """Sensor: mean and variance before the converter."""
        for effect in self.of("sensor"):
            signal = effect.respond(signal)
        return signal

    def effective_bits(self, bits: int) -> int:
        """Bits of the converter that count."""
        for effect in self.of("sensor"):
            bits = effect.effective_bits(bits)
        return bits
