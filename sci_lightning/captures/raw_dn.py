"""Raw DN out of files that store them in other ways: divided by something, or in a wider type."""

from __future__ import annotations

import numpy as np

from sci_lightning.errors import BadInput

BIT_DEPTHS = (8, 10, 12, 14, 16)
"""Usual bit depths of cameras."""
WHOLE = 0.12
"""Largest distance from a whole number of values that are multiples of one step."""
FEWEST = 16
"""Distinct values from which a common step is no chance."""
FINEST_BITS = 16
"""Bit depth that numbers get which are multiples of no step."""


def raw_dn(values: np.ndarray, where: str, bit_depth: int | None = None) -> tuple[np.ndarray, int]:
    """Return the whole numbers that a converter gave, and its bit depth.

    Floating-point files often hold DN that somebody has divided by a number. If all values are multiples of one step,
    they are divided by it. Otherwise they count as fractions of full scale and are rounded to ``bit_depth``, else to 16
    bits.

    Args:
        values: ``(N, H, W)``, 0 or more.
        where: the file, for messages.
        bit_depth: of the camera; None for the smallest usual one that holds the largest value.

    Returns:
        uint16 ``(N, H, W)``, and the bit depth.

    Raises:
        BadInput: negative values, NaN, values that need more bits, or fractions above 1.
    """
    low, high = (float(values.min()), float(values.max())) if values.size else (np.nan, np.nan)
    if values.size and np.isnan(low):
        number, row, column = np.argwhere(np.isnan(values))[0]
        raise BadInput(
            f"{where}: NaN in snapshot {number}, row {row}, column {column}; "
            "expected raw DN: finite numbers of 0 or more"
        )
    if not (low >= 0 and np.isfinite(high)):  # also where there is no value
        subtracted = "; was a dark frame subtracted? Give the raw snapshot" if -np.inf < low < 0 else ""
        raise BadInput(
            f"{where}: values from {low:g} to {high:g}, expected raw DN: finite numbers of 0 or more{subtracted}"
        )
    if values.dtype.kind != "f" or (high > 1 and np.equal(values, np.round(values)).all()):
        numbers = values
    elif (step := step_of(values)) is not None and high / step < 2**FINEST_BITS:
        numbers = np.round(values / step)
    elif high <= 1:
        bits = bit_depth or FINEST_BITS
        return np.round(values.astype(np.float64) * (2**bits - 1)).astype(np.uint16), bits
    else:
        raise BadInput(
            f"{where}: fractions up to {high:.9g}, expected raw DN or fractions of full scale, which do not exceed 1"
        )
    largest = int(numbers.max())
    fitting = [bits for bits in BIT_DEPTHS if largest < 2**bits]
    if largest >= 2 ** (bit_depth or FINEST_BITS):
        raise BadInput(f"{where}: values up to {largest} DN do not fit into {bit_depth or FINEST_BITS} bits")
    return numbers.astype(np.uint16), bit_depth or fitting[0]


def step_of(values: np.ndarray) -> float | None:
    """Return the step of which all values are multiples; None if there is no such step.

    It is at least a 65,535th of the largest value. A divided 12-bit image has the step that the division left.
    """
    distinct = np.unique(values.astype(np.float64))
    high = distinct[-1]
    if len(distinct) < FEWEST or high <= 0:
        return None
    distances = np.diff(distinct)
    distances = distances[distances > 0.3 * high / (2**FINEST_BITS - 1)]
    if not len(distances):
        return None
    step = float(np.median(distances[distances < 1.5 * distances.min()]))
    for reach in np.geomspace(min(50, high / step), high / step, 12):  # a longer lever with every pass
        near = distinct[distinct <= reach * step * 1.0001]
        if len(near) < 2:
            continue
        multiples = np.round(near / step)
        if not (multiples > 0).any():
            continue
        step = float((near * multiples).sum() / (multiples**2).sum())
    remainder = np.abs(distinct / step - np.round(distinct / step))
    return step if remainder.max() < WHOLE else None
