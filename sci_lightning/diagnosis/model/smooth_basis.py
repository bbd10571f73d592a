r"""Smooth maps: functions of the position on the field without detail finer than a part of its side.

On an axis the functions are Legendre's polynomials up to the degree ``DETAIL``, made orthonormal on the pixels. Light
that comes from afar is an analytic function, of which the factors fall fast with the degree, whatever its slope at the
edges is; those of a cosine series do not. A map is a sum of products of a function of the row and one of the column.
The constant product is left out, so that the mean over the field is 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import torch

DETAIL = 8
"""Parts of the field's side: no detail of a smooth map is finer."""
BEYOND = 12
"""The same for the functions that a smooth map must not contain, by which it is tested."""
LEAST_NORM = 1e-6
"""Relative norm below which a function is a sum of the others."""


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
    """Return K functions ``(K, H * W)`` of mean square 1 and mean 0, and their degrees ``(K,)``."""
    (down, of_rows), (across, of_columns) = axis_functions(height), axis_functions(width)
    products = torch.einsum("ih,jw->ijhw", down, across).flatten(0, 1).flatten(1)
    return products[1:], torch.hypot(of_rows[:, None], of_columns).flatten()[1:]


def prior(degree: torch.Tensor, steepness: float) -> torch.Tensor:
    """Return the standard deviations ``(K,)`` of the functions' factors for a map of standard deviation 1."""
    spread = degree**-steepness
    return spread / spread.norm().clamp(min=1e-30)


def beyond(height: int, width: int) -> torch.Tensor:
    """Return the functions ``(K, H * W)`` just finer than those of a smooth map, of mean square 1."""
    (down, of_rows), (across, of_columns) = axis_functions(height, BEYOND, True), axis_functions(width, BEYOND, True)
    products = torch.einsum("ih,jw->ijhw", down, across).flatten(0, 1).flatten(1)
    return products[torch.maximum(of_rows[:, None], of_columns).flatten() > DETAIL]


def axis_functions(count: int, finest: int = DETAIL, waves: bool = False) -> tuple[torch.Tensor, torch.Tensor]:
    """Return functions ``(L, n)`` of a place on an axis, the constant first, of mean square 1, and their degrees.

    Args:
        count: n, pixels.
        finest: largest degree, or number of half periods.
        waves: cosines in place of the polynomials.
    """
    place = (torch.arange(count, dtype=torch.float64) + 0.5) / count
    if waves:
        raw = [(k, torch.cos(math.pi * k * place)) for k in range(min(finest, (count - 1) // 2) + 1)]
    else:
        raw = [(k, torch.special.legendre_polynomial_p(2 * place - 1, k)) for k in range(min(finest, count - 1) + 1)]
    functions: list[torch.Tensor] = []
    degrees = []
    for degree, values in raw:
        size = float(values.square().mean().sqrt())
        for _ in range(2):  # twice is enough (Gram and Schmidt)
            for other in functions:
                values = values - (values * other).mean() * other
        norm = float(values.square().mean().sqrt())
        if norm > LEAST_NORM * size:
            functions.append(values / norm)
            degrees.append(float(degree))
    return torch.stack(functions), torch.tensor(degrees, dtype=torch.float64)


def quadrants(size: torch.Size) -> torch.Tensor:
    """Return +1 in two opposite quadrants of a field ``(H, W)`` and -1 in the others."""
    down, across = (torch.where(torch.arange(length) < length / 2, 1.0, -1.0) for length in size)
    return down[:, None] * across
