"""Optical blur: the lens between modulator and sensor (or its focus) blurs the modulated image."""

from __future__ import annotations

from dataclasses import replace

import torch

from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.signal import Signal
from sci_lightning.encoder.square_kernel import reach, square_kernel


class OpticalBlur(Effect):
    """The modulated image is blurred by a Gaussian, integrated over square pixels; beyond the field it is dark.

    Args:
        sigma: standard deviation in pixels, 0 to 8.
    """

    name = "optical_blur"
    stage = "optics"
    rank = 40
    subpixel = True
    about = {"sigma": Parameter("pixel", 0.0, 0, 8, step=0.03, starts=(0.3, 0.8))}
    sigma: torch.Tensor

    def form(self, signal: Signal) -> Signal:
        if float(self.sigma.detach()) < 1e-4:
            return signal.pooled()
        cells = signal.cells
        radius = reach(float(self.sigma.detach())) * cells + cells // 2
        steps = torch.arange(-radius, radius + 1).to(signal.mean) + (0.5 if cells % 2 == 0 else 0.0)
        kernel = square_kernel(steps, self.sigma * cells, cells)
        image, start = signal.mean[:, None], radius - cells // 2
        image = torch.nn.functional.conv2d(image, kernel.view(1, 1, -1, 1), stride=(cells, 1), padding=(start, 0))
        image = torch.nn.functional.conv2d(image, kernel.view(1, 1, 1, -1), stride=(1, cells), padding=(0, start))
        return replace(signal, mean=image[:, 0], cells=1)
