"""The base class of free-form deviations, which have as many numbers as needed and no name in the vocabulary."""

from __future__ import annotations

from typing import Any, ClassVar

import torch

from sci_lightning.configuration.bounds import Depth
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.errors import BadInput


class FreeForm(Effect):
    """A free-form deviation: it shows at which stage something is missing, not what.

    A subclass also derives from the base class of its stage. Its parameters are numbers called c0, c1, ..; those that
    are not given are 0, and with all at 0 the deviation is the identity.

    Args:
        count: how many numbers there are; None for those of the class.
        values: numbers by name.

    Raises:
        BadInput: a name that is none of them, or a value that is no number or out of bounds.
    """

    where: ClassVar[str]
    """What a report says if the captures ask for this deviation."""
    number: ClassVar[Parameter]
    """Unit, bounds and step of each number."""
    count: int
    """How many numbers there are; a class without one says it in :meth:`numbers`."""
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
    def of(cls, count: int) -> type[FreeForm]:
        """Return the subclass whose parameters are ``count`` numbers; an object of it has those that it is given."""
        about = {f"c{index}": cls.number for index in range(count)}
        body = {"about": about, "count": count, "__module__": cls.__module__, "__qualname__": cls.__qualname__}
        return type(cls.__name__, (cls,), body)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        """Return how many numbers there are for N captures of T slots each."""
        return cls.count

    @classmethod
    def proposals(
        cls, light: torch.Tensor, gradient: torch.Tensor, curvature: torch.Tensor
    ) -> list[list[dict[str, Value]]]:
        """Return settings at which a probe should try the deviation, in groups; empty if it is linear in its numbers.

        A deviation that is linear in its numbers is tried in all of them at once. One that is not, such as a copy of
        the image at an unknown displacement, proposes settings of small strength here.

        Args:
            light: ``(N, H, W)`` predicted captures, in DN.
            gradient: ``(N, H, W)`` of the log-likelihood with respect to the prediction.
            curvature: ``(N, H, W)`` expected negative second derivative of the log-likelihood, likewise.
        """
        return []

    @classmethod
    def scaled(cls, setting: dict[str, Value], factor: float) -> dict[str, Value]:
        """Return a proposed setting at ``factor`` times its strength, within bounds."""
        raise NotImplementedError

    @property
    def coefficients(self) -> torch.Tensor:
        """All numbers, ``(count,)``; 0 where none was given."""
        full = torch.zeros(self.count)
        for name in self.about:
            value = getattr(self, name)
            full = full.to(value).index_put((torch.tensor(int(name[1:])),), value)
        return full


def polynomials(y: torch.Tensor, x: torch.Tensor, degree: int) -> torch.Tensor:
    """Return products of Legendre polynomials up to ``degree`` in all, the constant first, ``(K, H, W)``.

    Args:
        y: ``(H, 1)`` and x ``(1, W)`` from -1 to 1.
    """
    down, across = legendre(y, degree), legendre(x, degree)
    return torch.stack([down[i] * across[total - i] for total in range(degree + 1) for i in range(total + 1)])


def legendre(x: torch.Tensor, degree: int) -> list[torch.Tensor]:
    """Return the Legendre polynomials of degree 0 to ``degree`` at x, which is in [-1, 1]."""
    values = [torch.ones_like(x), x]
    for n in range(1, degree):
        values.append(((2 * n + 1) * x * values[n] - n * values[n - 1]) / (n + 1))
    return values


def piecewise_linear(x: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
    """Return the curve at x that connects ``values`` (K,) at K equidistant places from 0 to 1 and is level beyond."""
    position = x.clamp(0, 1) * (len(values) - 1)
    low = position.detach().floor().long().clamp(max=len(values) - 2)
    share = position - low
    return values[low] * (1 - share) + values[low + 1] * share


class NeighbourTaps(FreeForm):
    """Light also falls on the neighbours of where it should, by a free kernel of 5 x 5 taps whose middle is 1.

    Args:
        count: 24.
        values: the neighbours' shares, row by row.
    """

    number = Parameter("1", 0.0, -1, 1, step=0.005)
    count = 24

    def border(self, size: tuple[int, int]) -> Border:
        return Border.around(((self.count + 1) ** 0.5 - 1) / 2 if self.coefficients.any() else 0.0)

    def smear(self, images: torch.Tensor, cells: int = 1) -> torch.Tensor:
        """Return images ``(N, H, W)`` convolved with the kernel, dark beyond their edges."""
        taps = self.coefficients.to(images)
        middle, side = len(taps) // 2, round((len(taps) + 1) ** 0.5)
        kernel = torch.cat((taps[:middle], torch.ones(1).to(taps), taps[middle:])).view(1, 1, side, side)
        return torch.nn.functional.conv2d(images[:, None], kernel.flip(-1, -2), padding="same", dilation=cells)[:, 0]
