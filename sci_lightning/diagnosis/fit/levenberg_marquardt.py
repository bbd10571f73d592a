"""The damped Newton method of Levenberg and Marquardt, for any objective that can be differentiated.

Source: Levenberg, Quart. Appl. Math. 2, 164 (1944); Marquardt, J. SIAM 11, 431 (1963).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

Point = TypeVar("Point")
Derivatives = TypeVar("Derivatives")

MIN_PROGRESS_NATS = 0.05
"""Gain below which a fit has converged; a twentieth of what one standard deviation of one parameter changes is far
below every threshold of the search."""
FIRST_DAMPING = 1e-3
"""Part of the information's diagonal that is added to it at first: one step nearly maximises a quadratic objective."""
LESS_DAMPING, MORE_DAMPING = 10, 20
"""The damping is divided by the first after a step that was accepted, and multiplied by the second after one that was
not: a few attempts span the range."""
MIN_DAMPING, MIN_DAMPING_AFTER_A_FAILURE = 1e-6, 1e-2
"""Least damping: rounding leaves nothing of less, and a step that was too long is not cured by less."""


def maximise(
    start: Point,
    differentiate: Callable[[Point], Derivatives],
    step: Callable[[Point, Derivatives, float, int], tuple[Point, float]],
    enough: Callable[[Point], float],
    iterations: int,
    attempts: int,
    hopeless: Callable[[Point, Derivatives], bool] = lambda point, derivatives: False,
) -> tuple[Point, Derivatives]:
    """Raise an objective by damped Newton steps until an iteration gains too little.

    A step that would lower the objective is repeated with more damping.

    Args:
        start: where to start.
        differentiate: the objective at a point.
        step: from a point, with its derivatives, the damping and the number of the attempt, from 0 on; returns where it
            leads, and the nats that it gains.
        enough: nats that the iteration that led to a point must have gained, or it is the last one.
        iterations: at most, at least 1.
        attempts: steps that are tried in an iteration.
        hopeless: whether nothing is to be had from a point, so that the iteration ends without a step.

    Returns:
        the last point, and the derivatives of the last iteration, which are those at its start.
    """
    point, damping = start, FIRST_DAMPING
    for iteration in range(iterations):
        derivatives = differentiate(point)
        if hopeless(point, derivatives):
            return point, derivatives
        gained = 0.0
        for attempt in range(attempts):
            moved, gain = step(point, derivatives, damping, attempt)
            if gain >= 0:
                point, gained, damping = moved, gain, max(damping / LESS_DAMPING, MIN_DAMPING)
                break
            damping = max(damping * MORE_DAMPING, MIN_DAMPING_AFTER_A_FAILURE)
        if gained < enough(point) or iteration == iterations - 1:
            return point, derivatives
    raise ValueError("iterations: at least 1 is needed")
