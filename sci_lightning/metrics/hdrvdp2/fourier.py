"""Fourier transforms of images that lie in the upper left of a larger periodic field of zeros.

Spectra are (..., field width // 2 + 1, field height): columns first, so that the second transform is contiguous, which
is much faster on a CPU.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from sci_lightning.metrics.hdrvdp2.tabulated import precomputed


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
