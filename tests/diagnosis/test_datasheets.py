"""Datasheets that are silent or wrong by a factor of 2: the noise is estimated, no name is lost and none invented."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.vocabulary import vocabulary
from tests.diagnosis import another_camera

NAMES = ("gain", "black_level", "mask_shift", "mask_contrast", "prnu", "illumination", "shot_noise", "read_noise")
FEW = {name: vocabulary()[name] for name in NAMES}
WELL, READ = another_camera.FULL_WELL, another_camera.READ_NOISE
NOISE = {"shot_noise", "read_noise"}


@pytest.mark.parametrize(
    ("well", "read", "differ"),
    [
        (None, None, set()),
        (2.0, 0.5, {"shot_noise", "read_noise"}),
        pytest.param(None, 1.0, set(), marks=pytest.mark.slow),
        pytest.param(0.5, 2.0, {"shot_noise", "read_noise"}, marks=pytest.mark.slow),
        pytest.param(2.0, 1.0, {"shot_noise"}, marks=pytest.mark.slow),
        pytest.param(1.0, 2.0, {"read_noise"}, marks=pytest.mark.slow),
        pytest.param(1.0, 0.5, {"read_noise"}, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize(
    "hidden",
    [
        {"black_level"},
        pytest.param({"mask_shift"}, marks=pytest.mark.slow),
        pytest.param(set(), marks=pytest.mark.slow),
    ],
)
def test_datasheet(well: float | None, read: float | None, differ: set[str], hidden: set[str]) -> None:
    faults = {"black_level": {"black": 0.02}, "mask_shift": {"shift": (0.3, -0.2)}}
    values = {name: value for fault in hidden for name, value in faults[fault].items()}
    captures = another_camera.captures(another_camera.Hidden(**values), size=32, seed=4, frames=4)  # type: ignore[arg-type]
    stated = replace(
        captures,
        full_well_e=None if well is None else well * WELL,
        read_noise_dn=None if read is None else read * READ,
    )
    result = diagnose(stated, FEW)
    assert set(result.names) == hidden | differ and not result.unnamed
    assert result.verdict == ("explained" if result.names else "consistent")
    noise = describe(result)["noise"]
    assert noise["shot_noise"]["full_well"] == pytest.approx(WELL, rel=0.1)
    assert noise["read_noise"]["std"] == pytest.approx(READ, rel=0.1)
    assert set(noise["stated_by_the_file"]) == {
        name for name, value in (("shot_noise", well), ("read_noise", read)) if value
    }
