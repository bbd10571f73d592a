"""A blur whose width changes with the squared radius, against the sum over every pixel's own Gaussian."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import FieldBlur, MaskShift, OpticalBlur
from sci_lightning.encoder.footprint import square_kernel
from tests.encoder.effects.conftest import encoder, seen

HEIGHT, WIDTH = 24, 30
LIGHT = (torch.rand(HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1)) > 0.5).float()
PATTERNS = torch.stack((LIGHT, 0 * LIGHT))  # all of it in the first of two slots


def direct(light: torch.Tensor, centre: float, corner: float) -> torch.Tensor:
    """The sum over all pixels, each with a Gaussian of its own, ``(H, W)`` float64."""
    rows, columns = torch.arange(HEIGHT).double(), torch.arange(WIDTH).double()
    total = torch.zeros(HEIGHT, WIDTH, dtype=torch.float64)
    middle = (HEIGHT - 1) / 2, (WIDTH - 1) / 2
    for row in range(HEIGHT):
        for column in range(WIDTH):
            place = ((row - middle[0]) ** 2 + (column - middle[1]) ** 2) / (middle[0] ** 2 + middle[1] ** 2)
            sigma = torch.tensor(centre + (corner - centre) * place).double().clamp(min=1e-9)
            down, across = square_kernel(rows - row, sigma), square_kernel(columns - column, sigma)
            total += float(light[row, column]) * down[:, None] * across
    return total


@pytest.mark.parametrize(
    ("centre", "corner", "tolerance"),
    [(0.0, 0.5, 1e-4), (0.2, 1.0, 3e-4), (0.0, 1.5, 5e-3), (1.2, 0.3, 3e-4), (0.5, 3.0, 5e-3)],
)
def test_direct_sum(centre: float, corner: float, tolerance: float) -> None:
    blurred = seen(FieldBlur(centre=centre, corner=corner), PATTERNS)
    torch.testing.assert_close(blurred.double(), direct(LIGHT, centre, corner), rtol=0, atol=tolerance)


def test_the_same_everywhere_is_an_optical_blur() -> None:
    even = seen(FieldBlur(centre=0.8, corner=0.8), PATTERNS)
    torch.testing.assert_close(even, seen(OpticalBlur(sigma=0.8), PATTERNS), rtol=0, atol=2e-6)
    assert FieldBlur.plainer == "optical_blur"


def test_light_of_cells() -> None:
    """Beside a displaced mask light is known on parts of pixels, which have places of their own."""
    camera = encoder(MaskShift(dx=0.0, dy=1.0), FieldBlur(centre=0.3, corner=1.2), pattern=PATTERNS)
    assert camera.path.cells > 1
    with torch.no_grad():
        blurred = camera(torch.ones(1, 2, HEIGHT, WIDTH))[0].double()
    moved = torch.zeros(HEIGHT, WIDTH)
    moved[1:] = LIGHT[:-1]
    torch.testing.assert_close(blurred, direct(moved, 0.3, 1.2), rtol=0, atol=0.02)
