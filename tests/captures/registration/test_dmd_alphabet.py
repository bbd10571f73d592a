"""A real photograph: the letters of a micromirror device, registered without a hint."""

from __future__ import annotations

from pathlib import Path

import pytest

from sci_lightning.encoder.light_path import LightPath
from sci_lightning.imaging.homography import pixels_per_mirror
from tests.diagnosis.dmd_alphabet import REGISTERED, judged, registered


@pytest.mark.slow
def test_letters_are_found(shared_data: Path) -> None:
    """An affine map is as right at the points, which it has not seen, as one that is fitted to them (median 10.9)."""
    folder = shared_data / "real" / "dmd_alphabet"
    registration, grid = registered(folder)
    across, down = (REGISTERED * pitch for pitch in pixels_per_mirror(grid.sensor_to_modulator, grid.field))
    assert across == pytest.approx(5.2, rel=0.05) and down == pytest.approx(2.6, rel=0.05)
    assert registration.correlation > 0.6 and judged(LightPath([], grid), folder, REGISTERED).median < 10.9
