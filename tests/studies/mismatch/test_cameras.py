"""The cameras of the protocol: the published one, its effects alone, and those that are drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.errors import BadInput
from sci_lightning.studies.mismatch.cameras import plan_cameras
from tests.studies.mismatch.conftest import PUBLISHED

RANGES: dict[str, Any] = {"mask_shift": {"dx": [-3, 3], "dy": [-3, 3]}, "gain": {"factor": [0.5, 1.5]}}


def test_the_configured_camera_is_the_published_one() -> None:
    conf = OmegaConf.to_container(OmegaConf.load(CONF / "mismatch.yaml"))
    assert isinstance(conf, dict) and conf["mismatch"] == PUBLISHED
    assert (conf["full_well_e"], conf["read_noise_dn"], conf["bit_depth"]) == (10000, 5, 12)
    assert conf["ranges"].keys() == PUBLISHED.keys()
    for name, parameters in PUBLISHED.items():  # the published camera lies within the ranges
        for parameter, value in parameters.items():
            low, high = conf["ranges"][name][parameter]
            assert low <= value <= high


def test_groups() -> None:
    cameras = plan_cameras(["alone", "drawn", "published"], PUBLISHED | {"gain": None}, RANGES, 2, 0)
    names = [camera.name for camera in cameras]
    assert names[:3] == ["published", "drawn_01", "drawn_02"] and len(names) == 9
    assert [camera.group for camera in cameras[:4]] == ["published", "drawn", "drawn", "alone"]
    assert "gain" not in cameras[0].mismatch
    assert cameras[3].name == "alone_mask_shift" and cameras[3].mismatch == {"mask_shift": PUBLISHED["mask_shift"]}


def test_drawn_cameras_lie_in_the_ranges_and_on_no_grid() -> None:
    cameras = plan_cameras(["drawn"], {}, RANGES, 200, 0)
    values = np.array([[camera.mismatch["mask_shift"]["dx"], camera.mismatch["gain"]["factor"]] for camera in cameras])
    low, high = values.min(0), values.max(0)
    assert (low >= [-3, 0.5]).all() and (high <= [3, 1.5]).all()
    assert (high - low > [5.5, 0.9]).all() and len(np.unique(values[:, 0])) == 200
    assert np.abs(values[:, 0] * 4 - np.round(values[:, 0] * 4)).min() > 0  # not on a grid of quarter pixels
    assert cameras[:3] == plan_cameras(["drawn"], {}, RANGES, 3, 0)
    assert cameras[0] != plan_cameras(["drawn"], {}, RANGES, 1, 1)[0]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"groups": ["publsihed"]}, "cameras: no 'publsihed'; choose of published, drawn, alone"),
        ({"mismatch": {"mask_shfit": {"dx": 1}}}, "mismatch: the virtual camera has no effect 'mask_shfit'"),
        ({"mismatch": {"gain": {"facter": 1}}}, "mismatch.gain: no parameter 'facter'; it has factor"),
        ({"mismatch": {"gain": {}}}, "mismatch.gain: no parameters; give factor"),
        ({"ranges": {"gain": {"factor": [1.5, 0.5]}}}, r"ranges.gain.factor=\[1.5, 0.5\]: expected \[low,high\]"),
        ({"ranges": {"gain": {"factor": 1.5}}}, r"ranges.gain.factor=1.5: expected \[low,high\]"),
        ({"groups": ["drawn"], "drawn": 0}, "no cameras"),
    ],
)
def test_bad_input(changed: dict[str, Any], message: str) -> None:
    settings: dict[str, Any] = {"groups": ["published"], "mismatch": PUBLISHED, "ranges": RANGES, "drawn": 1, "seed": 0}
    with pytest.raises(BadInput, match=message):
        plan_cameras(**{**settings, **changed})
