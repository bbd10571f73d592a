"""Field blur: the image is sharper in the centre of the field than in the corners, or the other way round."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.footprint import blurs_onto_pixels
from sci_lightning.encoder.signal import Signal

NODES = 8
"""Blurs of one width that the field's blur is composed of. Binary light of any arrangement is then right to 0.0003 from
0.2 to 1 pixel, to 0.005 from 0 to 1.5 pixels; with two nodes less, errors are four to eight times as large."""


class FieldBlur(OpticsEffect):
    r"""Light at distance r from the field's centre is blurred by :math:`\sigma = c + (k - c)\, r^2 / R^2`.

    R is the distance of the corner pixel's centre. As in ``optical_blur``, the Gaussian is integrated over square
    pixels, and it is dark beyond the field. The sum over all pixels is interpolated in :math:`r^2 / R^2` by the
    polynomial through ``NODES`` Chebyshev nodes: blurs of one width each, of light that is weighted by its place.
    Beside ``optical_blur``, both blurs integrate over the pixels.

    Args:
        centre, corner: c and k, standard deviations in pixels, 0 to 4.
    """

    name = "field_blur"
    rank = 40.5
    subpixel = True
    plainer: ClassVar[str | None] = "optical_blur"
    about = {
        "centre": Parameter("pixel", 0.0, 0, 4, step=0.03, starts=(0.0, 0.5)),
        "corner": Parameter("pixel", 0.0, 0, 4, step=0.03, starts=(0.2, 0.6, 1.2)),
    }
    sentence = "the image is blurred by sigma {centre} pixel in the centre and {corner} pixel in the corners"
    centre: torch.Tensor
    corner: torch.Tensor

    def border(self, size: tuple[int, int]) -> Border:
        return Border.of_blur(max(float(self.centre), float(self.corner)))

    def form(self, signal: Signal) -> Signal:
        if max(float(self.centre.detach()), float(self.corner.detach())) < 1e-6:
            return signal.pooled()
        light, place = signal.mean, signal.squared_radius()
        nodes = 0.5 - 0.5 * torch.cos(math.pi * torch.arange(NODES).to(light) / (NODES - 1))
        sigmas = torch.lerp(self.centre, self.corner, nodes.to(self.centre)).clamp(min=1e-6)
        down, across = (blurs_onto_pixels(length, signal.cells, sigmas, light) for length in light.shape[-2:])
        images = []
        for number, node in enumerate(nodes):
            others = [(place - other) / (node - other) for other in nodes if other != node]
            images.append(down[number] @ (torch.stack(others).prod(0) * light) @ across[number].T)
        return replace(signal, mean=torch.stack(images).sum(0), cells=1)
