"""A real photograph: the letters of a micromirror device, registered without a hint."""

from __future__ import annotations

from pathlib import Path

import pytest

from sci_lightning.homography import pixels_per_mirror
from tests.captures.registration.dmd_alphabet import REGISTERED, judged, registered


@pytest.mark.slow
def test_letters_are_found(shared_data: Path) -> None:
    """Homography and distortion are righter at the points, which they have not seen, than a homography fitted to them.

    The root mean square of that one is 8.1 pixels, its median 6.4; the aim is 5.
    """
    folder = shared_data / "real" / "dmd_alphabet"
    registration, path = registered(folder)
    grid = path.grid
    assert grid is not None
    across, down = (REGISTERED * pitch for pitch in pixels_per_mirror(grid.sensor_to_modulator, grid.field))
    assert across == pytest.approx(5.2, rel=0.05) and down == pytest.approx(2.6, rel=0.05)
    assert registration.correlation > 0.8 and -0.08 < registration.distortion < -0.03
    result = judged(path, folder, REGISTERED)
    assert result.median < 5 and result.rms < 8.1
