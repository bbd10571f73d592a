"""Datasheets that are silent or wrong by a factor of 2: the noise is estimated, no name is lost and none invented."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sci_lightning.captures import Captures
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


def moving(patterns: np.ndarray, sequence: list[list[int]], read: float, bits: int, well: float) -> Captures:
    """Ten captures of scenes that are as stated, by a camera without light from beyond; read noise 0 is stated."""
    random = np.random.default_rng(0)
    order = np.array([sequence[number % len(sequence)] for number in range(10)])
    scene = random.random((10, len(sequence[0]), *patterns.shape[1:])).astype(np.float32)
    scene[:4] *= 0.04
    light = np.stack([0.5 * (patterns[slots] * one).sum(0) for slots, one in zip(order, scene, strict=True)])
    noisy = random.poisson(light * well) / well * (2**bits - 1) + random.normal(0, read, light.shape)
    return Captures(
        patterns=patterns,
        sequence=order,
        measurement=np.clip(np.round(noisy), 0, 2**bits - 1).astype(np.uint16),
        scene=scene,
        aperture=np.full(10, 0.5, np.float32),
        exposure=np.ones(10, np.float32),
        kind=("dynamic",) * 10,
        bit_depth=bits,
        read_noise_dn=read,
        full_well_e=well,
        surround="dark",
    )


def test_no_read_noise_is_a_datasheet_too() -> None:
    patterns = (np.random.default_rng(1).random((4, 32, 32)) < 0.5).astype(np.float32)
    result = diagnose(moving(patterns, [[0, 1, 2, 3]], 0.0, 10, 1e5), {"gain": vocabulary()["gain"]})
    assert result.verdict == "consistent" and result.names == () and result.stated_noise == ("shot_noise", "read_noise")


def test_sequences_that_repeat_fewer_patterns_than_slots() -> None:
    patterns = (np.random.default_rng(1).random((2, 16, 16)) < 0.5).astype(np.float32)
    sequences = [[0, 1, 0, 1], [0, 0, 1, 1]]
    assert diagnose(moving(patterns, sequences, 0.8, 8, 1e4), {"gain": vocabulary()["gain"]}).names == ()
