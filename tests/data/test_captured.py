"""Which captures a decoder can be tested on, and one clear line where there are none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.captures import Captures, read_captures
from sci_lightning.data.captured import CapturedSnapshots
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, VirtualCamera


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> Captures:
    path = tmp_path_factory.mktemp("captured") / "lab.h5"
    session = Session((16, 24), frames=4, bit_depth=10, dark=1, flat=1, static=1, dynamic=3, unknown=1, aperture=0.5)
    VirtualCamera(session).write(path, seed=3)
    return read_captures(path)


def mask(captures: Captures) -> torch.Tensor:
    return torch.from_numpy(captures.patterns[:4])


def test_known_scenes_that_move(captures: Captures) -> None:
    moving = [index for index, kind in enumerate(captures.kind) if kind == "dynamic"]
    result = CapturedSnapshots(
        replace(captures, kind=("unknown",) * len(captures)), mask(captures)
    )  # labels don't count
    assert result.names == [f"capture_{index}" for index in moving] and len(result) == 3
    for number, index in enumerate(moving):
        place, video, measurement, aperture = result[number]
        assert place == number and float(aperture) == 0.5
        np.testing.assert_array_equal(video, captures.scene[index])
        np.testing.assert_allclose(measurement * 1023, captures.measurement[index], atol=1e-3)
        light = float(aperture) * (video * mask(captures)).sum(0)
        assert (light - measurement).abs().mean() < 0.02  # nothing is hidden in this camera


def test_only_those_behind_the_mask(captures: Captures) -> None:
    sequence = captures.sequence.copy()
    last = int(np.flatnonzero([kind == "dynamic" for kind in captures.kind])[-1])
    sequence[last] = sequence[last, ::-1]
    result = CapturedSnapshots(replace(captures, sequence=sequence), mask(captures))
    assert len(result) == 2 and f"capture_{last}" not in result.names
    reversed_order = CapturedSnapshots(replace(captures, sequence=sequence), mask(captures).flip(0))
    assert reversed_order.names == [f"capture_{last}"]
    assert len(CapturedSnapshots(captures, mask(captures) + 0.4 / 255)) == 3  # less than a modulator's level


def test_none_to_test_on(captures: Captures, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"lab\.h5: .*4 x 16 x 24.*8 x 16 x 24"):
        CapturedSnapshots(captures, torch.zeros(8, 16, 24))
    with pytest.raises(BadInput, match=r"none of its 3 captures .*moves shows .*mask"):
        CapturedSnapshots(captures, 1 - mask(captures))
    still = captures.take([kind != "dynamic" for kind in captures.kind])
    with pytest.raises(BadInput, match=rf"none of its {len(still)} captures is .*moves"):
        CapturedSnapshots(still, mask(captures))
