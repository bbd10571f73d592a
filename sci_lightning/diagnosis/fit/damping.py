"""The damping of Newton steps that would lower what they are to raise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass
class Damping:
    """How much the steps of a fit are damped: less after a step that was accepted, more after one that was not.

    Source: Levenberg, Quart. Appl. Math. 2, 164 (1944); Marquardt, J. SIAM 11, 431 (1963).

    Attributes:
        most: steps that are tried in an iteration, each with more damping than the one before.
        value: what is added to the information, as a part of its diagonal.
        accepted: whether the attempt under way was accepted; set by the fit.
    """

    most: int
    value: float = 1e-3
    accepted: bool = False

    def attempts(self) -> Iterator[int]:
        """Yield the numbers of an iteration's attempts, from 0 on, until one was accepted."""
        for attempt in range(self.most):
            self.accepted = False
            yield attempt
            if self.accepted:
                self.value = max(self.value / 10, 1e-6)
                return
            self.value = max(self.value * 20, 1e-2)
