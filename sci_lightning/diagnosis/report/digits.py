"""Numbers with the digits that mean something."""

from __future__ import annotations

import math

from sci_lightning.encoder.effects.parameter import Value


def quantity(value: Value, std: float = 0.0, systematic: float = 0.0) -> str:
    """Return a number and its statistical uncertainty, rounded to the digits that mean something.

    The last digit is the second significant one of ``std``, or the first one that is not finer than ``systematic``,
    whichever is coarser. An uncertainty below half of that digit is left out: then formulas limit the digits.

    Args:
        value: of a parameter; what is no ``float`` is a choice, and exact.
        std: its standard deviation, statistical.
        systematic: what its systematic error is at least, see
            :func:`~sci_lightning.diagnosis.search.evidence.systematic_limit`.
    """
    if not isinstance(value, float):
        return str(value)
    known = [math.floor(math.log10(std)) - 1] if std > 0 and math.isfinite(std) else []
    known += [math.ceil(math.log10(systematic) - 1e-9)] if systematic > 0 and math.isfinite(systematic) else []
    if not known or not math.isfinite(value):
        return f"{value:.6g}"
    place = max(known)
    text = _rounded(value, place)
    if not 0.5 * 10.0**place <= std < math.inf:
        return text
    return f"{text} \u00b1 {_rounded(std, place)}"


def uncertainty(std: float) -> str:
    """Return a standard deviation with two significant digits, nothing if there is none."""
    return _rounded(std, math.floor(math.log10(std)) - 1) if 0 < std < math.inf else ""


def chi2(value: float) -> str:
    """Return a reduced chi2 with the digits that mean something."""
    return f"{value:.0f}" if value >= 1000 else f"{value:.4g}" if value >= 10 else f"{value:.3f}"


def _rounded(value: float, place: int) -> str:
    """``value`` with the last digit at 10 ** place."""
    return f"{round(value, -place):.{max(0, -place)}f}"
