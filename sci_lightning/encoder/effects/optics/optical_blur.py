"""Optical blur: the lens between modulator and sensor (or its focus) blurs the modulated image."""

from __future__ import annotations

from dataclasses import replace

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.footprint import blurs_onto_pixels
from sci_lightning.encoder.signal import Signal


class OpticalBlur(OpticsEffect):
    """The modulated image is blurred by a Gaussian, integrated over square pixels; beyond the field it is dark.

    Args:
        sigma: standard deviation in pixels, 0 to 8.
    """

    name = "optical_blur"
    rank = 40
    subpixel = True
    about = {"sigma": Parameter("pixel", 0.0, 0, 8, step=0.03, starts=(0.3, 0.8))}
    sentence = "the whole image is blurred (sigma {sigma} pixel)"
    sigma: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        return Border.of_blur(float(self.sigma))

    def form(self, signal: Signal) -> Signal:
        if float(self.sigma.detach()) < 1e-6:
            return signal.pooled()
        light, q = signal.mean, signal.cells
        down, across = (blurs_onto_pixels(length, q, self.sigma, light) for length in light.shape[-2:])
        return replace(signal, mean=down @ light @ across.T, cells=1)
