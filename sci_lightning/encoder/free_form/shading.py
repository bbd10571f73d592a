"""Shading: some parts of the image receive less light than others."""

from __future__ import annotations

import torch

from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.free_form.free_form import Empirical, polynomials
from sci_lightning.encoder.signal import Signal

DEGREE = 4


class Shading(Empirical, OpticsEffect):
    """The light is multiplied by 1 + a polynomial of the position.

    Args:
        count: 14 for polynomials up to degree 4 without the constant.
        values: coefficients of the products of Legendre polynomials, by degree.
    """

    name = "shading"
    rank = 45
    where = "parts of the image receive less light than others"
    number = Parameter("1", 0.0, -4, 4, step=0.005)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return (DEGREE + 1) * (DEGREE + 2) // 2 - 1

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        return signal.with_mean(signal.mean * (1 + smooth(signal, self.coefficients, DEGREE, constant=False)))


def smooth(signal: Signal, coefficients: torch.Tensor, degree: int, constant: bool) -> torch.Tensor:
    """Return a polynomial of the position in the field, ``(H, W)``."""
    y, x = signal.coordinates()
    basis = polynomials(y * (2 / signal.field[0]), x * (2 / signal.field[1]), degree)
    return torch.einsum("k,khw->hw", coefficients.to(signal.mean), basis if constant else basis[1:])
