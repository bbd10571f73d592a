"""The light scale of a snapshot: which number is full scale, and which light a white frame gives.

A decoder takes y / (full scale * aperture), near the sum over time of mask times frame with white as 1. Where nothing
states the two, they follow from the numbers. A camera's snapshot never exceeds full scale; an ordinary exposure is one
in which a white scene just fills the sensor, so that the aperture is 1 over the mean of the mask's sum over time. A sum
of frames made by software exceeds full scale and has aperture 1.

A diagnosis needs the whole numbers of the converter instead, out of files that store them divided by something or in a
wider type.
"""

from __future__ import annotations

import numpy as np
import torch

from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput

LEAST_AT_TOP = 4096
"""Numbers that do not exceed this are taken as they stand, even if all are multiples of a power of two."""
LARGEST_SUM = 100.0
"""A sum of frames in units of white is at most T; whole numbers in a floating-point file above this are DN."""
BRIGHT = 0.99
"""Quantile of a video's values that counts as its bright end: single pixels, as at the dark edge of a mask, do not."""
DARK_FRAMES, BRIGHT_FRAMES = 0.25, 1.3
"""Bright ends of a video, white being 1, below and above which its light scale is doubtful."""
MOST_SAMPLED = 2**20


def full_scale_of(values: np.ndarray, bit_depth: int | None = None) -> tuple[float, str]:
    """Return which number means full scale, and why; whole numbers are judged, others are fractions of full scale.

    Args:
        values: as a file has them.
        bit_depth: of the sensor, which counts if no value exceeds it.
    """
    largest = float(values.max(initial=0))
    if values.dtype.kind == "f":
        if largest <= LARGEST_SUM or not np.array_equal(values, np.rint(values)):
            return 1.0, "a floating-point file"
        values = values.astype(np.int64)
    if bit_depth is not None and largest < 2**bit_depth:
        return 2**bit_depth - 1, f"the sensor's {bit_depth} bits"
    every_bit = int(np.bitwise_or.reduce(values, axis=None))
    unused = (every_bit & -every_bit).bit_length() - 1  # low bits that are 0 in every value
    if LEAST_AT_TOP <= largest < 2**16 and values.min() >= 0:
        bits = next(bits for bits in BIT_DEPTHS if bits >= 16 - unused)
        if bits < 16:
            return (2**bits - 1) << (16 - bits), f"{bits} bits at the top of 16: multiples of {2 ** (16 - bits)}"
    bits = next((bits for bits in BIT_DEPTHS if largest < 2**bits), int(largest).bit_length())
    return 2**bits - 1, f"the largest value is {largest:g}: {bits} bits"


def resolve_aperture(
    given: float | str | torch.Tensor | None, encoder: Encoder, mask: torch.Tensor, brightest: float, own_mask: bool
) -> tuple[float | torch.Tensor, str]:
    """Return the aperture of a snapshot and where it comes from.

    Args:
        given: what the user states: a number, ``auto`` for an ordinary exposure, or None; or what measurements carry.
        encoder: that took the snapshot.
        mask: ``(T, H, W)``.
        brightest: largest value of the snapshot, in units of full scale.
        own_mask: whether the mask is the encoder's own; else its automatic aperture is that of ``mask``.

    Raises:
        BadInput: a stated aperture that is neither ``auto`` nor a positive number; none, where the encoder gives every
            snapshot a scale of its own.
    """
    if isinstance(given, torch.Tensor):
        return given, "the measurement's"
    ordinary = 1 / max(1.0, float(mask.sum(0).mean()))
    if given is not None and given != "auto":
        if isinstance(given, str) or not 0 < given < float("inf"):
            raise BadInput(f"aperture={given}: give a positive number, or auto for an exposure that white fills")
        return given, "as given"
    if given == "auto":
        return ordinary, "white fills the sensor"
    aperture = encoder.aperture
    states = encoder.sensor.bit_depth is not None or aperture != 1
    if states and (own_mask or aperture != encoder.mask.automatic_aperture):
        return aperture, "the encoder's"
    if states:
        return ordinary, "white fills the sensor"
    if brightest > 1:
        return 1.0, "values exceed full scale, as in a sum of frames"
    return ordinary, "no value exceeds full scale: an exposure that white fills; aperture=1 for a sum of frames"


def bright_end(video: np.ndarray) -> float:
    """Return the bright end of a video ``(N, T, H, W)``, or of one in colour, from some of its pixels."""
    step = max(1, int((video.size / MOST_SAMPLED) ** 0.5))
    return float(np.quantile(video[:, :, ::step, ::step], BRIGHT))


def doubtful_brightness(bright: float, full_scale: float, aperture: float) -> str:
    """Return one line that says that frames are far too dark or too bright for their light scale, else nothing."""
    if DARK_FRAMES <= bright <= BRIGHT_FRAMES:
        return ""
    state = "dark" if bright < DARK_FRAMES else "brighter than white"
    better = f"; aperture={aperture * bright / 0.9:.3g} would bring them to white" if bright > 1e-3 else ""
    return (
        f"the frames come out {state}: their bright end is {bright:.2g} of white at full_scale={full_scale:g} and "
        f"aperture={aperture:.3g}; if the scene was not, check both{better}"
    )


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
