"""What all free-form deviations have in common: as many numbers as it takes, and no name in the vocabulary."""

from __future__ import annotations

from typing import Any, ClassVar

import torch

from sci_lightning.configuration.bounds import Depth
from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.errors import BadInput


class Empirical(Effect):
    """A deviation of free form: it says in which stage something is missing, not what.

    Its numbers are called c0, c1, ..; those that are not given are 0, and all at 0 are the identity.

    Args:
        count: how many there are.
        values: numbers by name.

    Raises:
        BadInput: a name that is none of them, or a value that is no number or out of bounds.
    """

    where: ClassVar[str]
    """What it means if the captures ask for it, in words."""
    number: ClassVar[Parameter]
    """Unit, bounds and step of each number."""
    of_captures: ClassVar[bool] = False
    """Whether it is a matter of the captures, not of the camera."""
    count: int
    about: ClassVar[dict[str, Parameter]] = {}

    def __init__(self, count: Depth | None = None, **values: Any) -> None:
        if count is not None:
            self.count = count
        names = [f"c{index}" for index in range(self.count)]
        for name in values:
            if name not in names:
                raise BadInput(f"effect {self.name} has numbers c0 to c{self.count - 1}, not '{name}'")
        self.about = dict.fromkeys(values, self.number)  # type: ignore[misc]
        super().__init__(**values)

    @classmethod
    def of(cls, count: int) -> type[Empirical]:
        """The class with ``count`` numbers as its parameters; an object has those that it is given."""
        about = {f"c{index}": cls.number for index in range(count)}
        body = {"about": about, "count": count, "__module__": cls.__module__, "__qualname__": cls.__qualname__}
        return type(cls.__name__, (cls,), body)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        """How many there are for N captures of T slots each."""
        raise NotImplementedError

    @property
    def coefficients(self) -> torch.Tensor:
        """``(count,)``."""
        full = torch.zeros(self.count)
        for name in self.about:
            value = getattr(self, name)
            full = full.to(value).index_put((torch.tensor(int(name[1:])),), value)
        return full


def polynomials(y: torch.Tensor, x: torch.Tensor, degree: int) -> torch.Tensor:
    """Products of Legendre polynomials up to ``degree`` in all, the constant first: ``(K, H, W)``.

    Args:
        y: ``(H, 1)`` and x ``(1, W)`` from -1 to 1.
    """
    down, across = legendre(y, degree), legendre(x, degree)
    return torch.stack([down[i] * across[total - i] for total in range(degree + 1) for i in range(total + 1)])


def legendre(x: torch.Tensor, degree: int) -> list[torch.Tensor]:
    """Legendre polynomials of degree 0 to ``degree``, on [-1, 1]."""
    found = [torch.ones_like(x), x]
    for n in range(1, degree):
        found.append(((2 * n + 1) * x * found[n] - n * found[n - 1]) / (n + 1))
    return found


def piecewise_linear(x: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """The curve through ``values`` (K,) at K equidistant places from 0 to 1, level beyond them."""
    place = x.clamp(0, 1) * (len(values) - 1)
    low = place.detach().floor().long().clamp(max=len(values) - 2)
    share = place - low
    return values[low] * (1 - share) + values[low + 1] * share


def window_of_taps(coefficients: torch.Tensor) -> torch.Tensor:
    """A square kernel ``(1, 1, side, side)`` of all taps but the middle one, which is 1."""
    middle = len(coefficients) // 2
    side = round((len(coefficients) + 1) ** 0.5)
    one = torch.ones(1).to(coefficients)
    return torch.cat((coefficients[:middle], one, coefficients[middle:])).view(1, 1, side, side)
