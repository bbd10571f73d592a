"""What the stages compute with: Fourier transforms in a larger field, resizing by MATLAB's rules, and tables.

Spectra are (..., field width // 2 + 1, field height): columns first, so that the second transform is contiguous, which
is much faster on a CPU.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache, wraps

import torch

DARKEST, BRIGHTEST = -5.0, 5.0
"""Range of the tables: log10 of luminance in cd/m2."""


def log_luminances(points: int) -> torch.Tensor:
    """Return the equally spaced values of log10 luminance of a table with so many points."""
    return torch.linspace(DARKEST, BRIGHTEST, points, dtype=torch.float64)


def look_up(table: torch.Tensor, log_luminance: torch.Tensor) -> torch.Tensor:
    """Return values at ``log_luminance``, of any shape: linear between the points of a table, constant beyond."""
    last = len(table) - 1
    place = (log_luminance.clamp(DARKEST, BRIGHTEST) - DARKEST) * (last / (BRIGHTEST - DARKEST))
    below = place.detach().long().clamp(max=last - 1)
    start = table[below]
    return start + (place - below) * (table[below + 1] - start)


def precomputed(make: Callable[..., torch.Tensor]) -> Callable[..., torch.Tensor]:
    """Decorate a function that returns float64 (or complex128) on the CPU, so that its values are computed once.

    The decorated function takes one more argument, the first: a tensor, on whose device and in whose precision the
    value is returned. Values are kept for every device, precision and set of arguments.
    """

    @lru_cache(maxsize=64)
    def made(device: torch.device, dtype: torch.dtype, *args: Hashable) -> torch.Tensor:
        with torch.inference_mode(False):  # a kept value must also serve calls with gradients
            value = make(*args)
            return value.to(device, dtype.to_complex() if value.is_complex() else dtype)

    @wraps(make)
    def alike(like: torch.Tensor, *args: Hashable) -> torch.Tensor:
        return made(like.device, like.dtype, *args)

    return alike


def spectrum(images: torch.Tensor, field: Sequence[int]) -> torch.Tensor:
    """Return the spectrum of images (..., H, W) in a field of the given height and width."""
    return torch.fft.fft(torch.fft.rfft(images, field[1]).mT, field[0])


def upper_left(spectrum: torch.Tensor, field: Sequence[int], size: Sequence[int]) -> torch.Tensor:
    """Return the upper left part (..., *size) of the image with this spectrum in ``field``."""
    rows = torch.fft.ifft(spectrum)[..., : size[0]].mT
    return torch.fft.irfft(rows, field[1])[..., : size[1]]


@precomputed
def frequencies(field: tuple[int, int], pixels_per_degree: float) -> torch.Tensor:
    """Return the frequency of every value of a spectrum in cycles per degree, (field width // 2 + 1, field height)."""
    down = torch.fft.fftfreq(field[0], dtype=torch.float64) * pixels_per_degree
    across = torch.fft.rfftfreq(field[1], dtype=torch.float64) * pixels_per_degree
    return torch.hypot(across[:, None], down)


def imresize(images: torch.Tensor, size: Sequence[int]) -> torch.Tensor:
    """Resize (..., H, W) to (..., *size) with a cubic of a = -0.5, widened for shrinking, and mirrored borders.

    At ratios other than powers of two the weights do not sum to 1, and are not normalised, as for the reference values.
    """
    down, across = (
        None if old == new else weights(images, old, new) for old, new in zip(images.shape[-2:], size, strict=True)
    )
    images = images if down is None else down @ images
    return images if across is None else images @ across.mT


@precomputed
def weights(old: int, new: int) -> torch.Tensor:
    """Return the matrix (new, old) that makes every new sample a weighted sum of the old ones."""
    scale = new / old
    stretch = min(scale, 1.0)
    centre = (torch.arange(new, dtype=torch.float64) + 0.5) / scale - 0.5
    reach = math.ceil(4 / stretch) + 2
    taps = (centre - 2 / stretch).floor()[:, None] + torch.arange(reach)
    tap_weights = stretch * cubic(stretch * (centre[:, None] - taps))
    index = taps.long() % (2 * old)
    index = torch.where(index < old, index, 2 * old - 1 - index)
    return torch.zeros(new, old, dtype=torch.float64).scatter_add_(1, index, tap_weights)


def cubic(x: torch.Tensor) -> torch.Tensor:
    """Return the cubic convolution kernel (Keys, 1981) with a = -0.5."""
    x = x.abs()
    near = (1.5 * x - 2.5) * x * x + 1
    far = ((-0.5 * x + 2.5) * x - 4) * x + 2
    return torch.where(x <= 1, near, torch.where(x <= 2, far, 0.0))
