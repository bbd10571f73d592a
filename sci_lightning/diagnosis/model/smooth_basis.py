r"""Smooth maps: functions of the position on the field without detail much finer than a part of its side.

On an axis the functions are Legendre's polynomials up to the degree ``MAX_DEGREE``, made orthonormal on the pixels.
Uneven light varies so smoothly that its factors fall fast with the degree, whatever its slope at the edges is; those of
a cosine series fall slowly where that slope is not 0. A map is a sum of products of a function of the row and one of
the column. The constant product is left out, so that the mean over the field is 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch

MAX_DEGREE = 8
"""Largest degree of the polynomials along an axis. They hold nine tenths of the variance of a wave of six half periods,
and a third of that of one of seven."""
MAX_HALF_PERIODS, MAX_TESTED_HALF_PERIODS = 6, 12
"""Half periods along an axis of the waves by which a smooth map is tested: more than the first number, which it must
not contain, up to the second."""


@dataclass(frozen=True)
class SmoothBasis:
    """Functions on a field, in a basis in which the information about them and their prior are diagonal.

    Attributes:
        functions: ``(K, H, W)`` float64, the functions that the K coordinates multiply.
        dual: ``(K, H, W)``; the sum of a map times these gives its coordinates.
        mixing: ``(K, K)``, from coordinates to factors of orthonormal functions.
        seen: ``(K, h, w)``, the functions at the pixels that count.
    """

    functions: torch.Tensor
    dual: torch.Tensor
    mixing: torch.Tensor
    seen: torch.Tensor

    @staticmethod
    def of(
        information: torch.Tensor, steepness: float, window: tuple[slice, slice] = (slice(None), slice(None))
    ) -> SmoothBasis:
        """Return the basis in which the information about the coordinates is diagonal and their prior is even.

        With coordinates of standard deviation s the map has standard deviation s.

        Args:
            information: ``(H, W)`` about the map's value at every pixel.
            steepness: power of the degree with which the prior's standard deviation falls.
            window: rows and columns that count.
        """
        height, width = information.shape
        flat, degree = orthonormal(height, width)
        spread = prior(degree, steepness)
        about = (flat * information.flatten().double()) @ flat.T
        _, turn = torch.linalg.eigh(spread[:, None] * about * spread)
        mixing = spread[:, None] * turn
        functions = (mixing.T @ flat).reshape(-1, height, width)
        dual = (turn.T @ (flat / spread[:, None])).reshape(-1, height, width) / (height * width)
        return SmoothBasis(functions, dual, mixing, functions[:, window[0], window[1]].contiguous())

    def coordinates(self, field_map: torch.Tensor) -> torch.Tensor:
        """Return the coordinates ``(K,)`` of a map ``(H, W)``."""
        return self.dual.flatten(1) @ field_map.flatten().double()

    def field(self, coordinates: torch.Tensor) -> torch.Tensor:
        """Return the map ``(H, W)`` of coordinates ``(K,)``, on the whole field."""
        return (coordinates.double() @ self.functions.flatten(1)).unflatten(-1, self.functions.shape[1:])

    def spread(self, coordinates: torch.Tensor) -> torch.Tensor:
        """Return the maps ``(.., h, w)`` of coordinates ``(.., K)`` at the pixels that count."""
        return (coordinates.double() @ self.seen.flatten(1)).unflatten(-1, self.seen.shape[1:])

    def reduce(self, field: torch.Tensor) -> torch.Tensor:
        """Return the sums ``(.., K)`` of fields ``(.., h, w)`` times every function."""
        return field.flatten(-2).double() @ self.seen.flatten(1).T

    def squares(self, field: torch.Tensor) -> torch.Tensor:
        """Return the sum ``(K,)`` of a field ``(h, w)`` times the square of every function."""
        return self.seen.flatten(1).square() @ field.flatten().double()

    def variance(self, variance: torch.Tensor) -> torch.Tensor:
        """Return the variance ``(h, w)`` of a map whose coordinates have the variances ``(K,)``."""
        return (variance @ self.seen.flatten(1).square()).reshape(self.seen.shape[1:])

    def gram(self, field: torch.Tensor) -> torch.Tensor:
        """Return the sums ``(K, K)`` of a field ``(h, w)`` times every product of two functions."""
        flat = self.seen.flatten(1)
        return (flat * field.flatten().double()) @ flat.T


@lru_cache(maxsize=4)
def orthonormal(height: int, width: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Return K functions ``(K, H * W)`` of mean square 1 and mean 0, and their degrees ``(K,)``.

    The degree of a product is the root of the sum of the squared degrees along both axes.
    """
    down, across = polynomials(height), polynomials(width)
    of_rows, of_columns = (torch.arange(len(functions), dtype=torch.float64) for functions in (down, across))
    return _products(down, across)[1:], torch.hypot(of_rows[:, None], of_columns).flatten()[1:]


def prior(degree: torch.Tensor, steepness: float) -> torch.Tensor:
    """Return the standard deviations ``(K,)`` of the functions' factors for a map of standard deviation 1."""
    spread = degree**-steepness
    return spread / spread.norm().clamp(min=1e-30)


def beyond(height: int, width: int) -> torch.Tensor:
    """Return the waves ``(K, H * W)`` just finer than a smooth map, of mean square 1."""
    down, across = _cosines(height), _cosines(width)
    of_rows, of_columns = torch.arange(len(down)), torch.arange(len(across))
    return _products(down, across)[torch.maximum(of_rows[:, None], of_columns).flatten() > MAX_HALF_PERIODS]


def polynomials(count: int) -> torch.Tensor:
    """Return the polynomials ``(L, n)`` of the place on an axis of n pixels, of mean square 1; the constant first."""
    place = (2 * torch.arange(count, dtype=torch.float64) + 1) / count - 1
    degrees = range(min(MAX_DEGREE, count - 1) + 1)
    columns, _ = torch.linalg.qr(torch.stack([torch.special.legendre_polynomial_p(place, k) for k in degrees], 1))
    return columns.T * columns[-1:].sign().T * math.sqrt(count)


def _cosines(count: int) -> torch.Tensor:
    """Return the waves ``(L, n)`` along an axis, of 0, 1, 2 .. half periods and of mean square 1."""
    place = (torch.arange(count, dtype=torch.float64) + 0.5) / count
    most = min(MAX_TESTED_HALF_PERIODS, (count - 1) // 2)
    waves = torch.stack([torch.cos(math.pi * k * place) for k in range(most + 1)])
    return waves / waves.square().mean(1, keepdim=True).sqrt()


def _products(down: torch.Tensor, across: torch.Tensor) -> torch.Tensor:
    """Return all products ``(K, H * W)`` of a function of the row and one of the column."""
    return torch.einsum("ih,jw->ijhw", down, across).flatten(0, 1).flatten(1)


def quadrants(size: torch.Size) -> torch.Tensor:
    """Return +1 in two opposite quadrants of a field ``(H, W)`` and -1 in the others."""
    down, across = (torch.where(torch.arange(length) < length / 2, 1.0, -1.0) for length in size)
    return down[:, None] * across
