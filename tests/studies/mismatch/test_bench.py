"""The bench: the virtual camera records, and the encoder that knows the truth agrees with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sci_lightning.errors import BadInput
from sci_lightning.studies.mismatch.beliefs import ideal_camera, true_camera
from sci_lightning.studies.mismatch.bench import Bench
from tests.studies.mismatch.conftest import FEW, PUBLISHED, made_bench


@pytest.mark.parametrize("mismatch", [{}, PUBLISHED], ids=["ideal", "published"])
def test_the_true_encoder_predicts_what_the_virtual_camera_records(bench: Bench, mismatch: dict[str, Any]) -> None:
    recorded = bench.record(mismatch, noise=False)
    encoder = true_camera(bench, mismatch) if mismatch else ideal_camera(bench)
    with torch.no_grad():
        predicted = encoder(torch.cat(bench.videos)).numpy() * bench.full_scale
    assert recorded.shape == (3, 32, 32) and recorded.dtype == np.uint16
    # 0.1 DN of 8 bits: footprints of a turned pixel's quarters are taken as upright, and the converter rounds
    np.testing.assert_allclose(predicted, recorded, rtol=0, atol=0.1 * 4095 / 255 + 0.5)


def test_no_snapshot_saturates(bench: Bench) -> None:
    assert bench.aperture == 1 / 4
    assert bench.record(PUBLISHED).max() < 4095


def test_noise_is_that_of_the_datasheet_and_not_that_of_the_calibration(bench: Bench) -> None:
    noise = bench.record({}).astype(float) - bench.record({}, noise=False)
    mean = bench.record({}, noise=False) / 4095
    expected = np.sqrt(5**2 + 1 / 6 + mean / 10000 * 4095**2)
    assert (noise / expected).std() == pytest.approx(1, abs=0.05)
    assert np.array_equal(bench.record(PUBLISHED), bench.record(PUBLISHED))
    other = bench.calibration({}).measurement[:3].astype(float)  # dark and flat frames
    flat = other[2] - np.median(other[2])
    assert abs(np.corrcoef(noise[2].ravel(), flat.ravel())[0, 1]) < 0.15


def test_captures_of_both_kinds(bench: Bench) -> None:
    calibration = bench.calibration(PUBLISHED)
    assert len(calibration) == 2 + 2 + 1 + 1 + 4 + 2 + 2 and calibration.known.all()
    assert calibration.surround == "dark" and calibration.full_well_e == 10000
    measurement = bench.record(PUBLISHED)
    for most, chosen in ((2, [0, 2]), (8, [0, 1, 2])):
        snapshots = bench.snapshots(measurement, most)
        assert not snapshots.known.any() and np.array_equal(snapshots.measurement, measurement[chosen])
    assert snapshots.patterns.shape == (4, 32, 32) and snapshots.inferred_kind == ("unknown",) * 3


def test_the_digest_is_of_everything_that_is_recorded(tmp_path: Path) -> None:
    different = [made_bench(tmp_path / "a").digest]
    assert made_bench(tmp_path / "b").digest == different[0]  # wherever the patterns are kept
    different += [made_bench(tmp_path / "c", seed=1).digest, made_bench(tmp_path / "d", middle=[24, 24]).digest]
    different += [made_bench(tmp_path / "e", calibration={**FEW, "dark": 3}).digest]
    assert len(set(different)) == 4


def test_the_middle_of_scenes_and_mask(tmp_path: Path) -> None:
    np.save(tmp_path / "mask.npy", np.random.default_rng(0).integers(0, 2, (4, 32, 32)))
    whole = made_bench(tmp_path / "a", mask=tmp_path / "mask.npy")
    middle = made_bench(tmp_path / "b", mask=tmp_path / "mask.npy", middle=[16, 20])
    assert torch.equal(middle.videos[1], whole.videos[1][..., 8:24, 6:26])
    assert np.array_equal(np.load(middle.session.mask), np.load(tmp_path / "mask.npy")[:, 8:24, 6:26])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"mask": "nowhere.npy"}, "nowhere.npy"),
        ({"mask": "mask.npy"}, r"mask=.*mask.npy: holds \(8, 16, 16\) .*scenes are \(4, 32, 32\).*frames=8 'size"),
        ({"middle": [40, 20]}, r"middle=\[40, 20\]: larger than the scenes, which are \[32, 32\]"),
        ({"middle": [8, 8]}, r"middle=\[8, 8\]: expected at least 16 pixels"),
        ({"calibration": {**FEW, "darks": 3}}, "calibration: no 'darks'"),
        ({"calibration": dict.fromkeys(FEW, 0)}, "no captures"),
    ],
)
def test_bad_input(changed: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("mask.npy", np.ones((8, 16, 16)))
    with pytest.raises(BadInput, match=message):
        made_bench(tmp_path, **changed)


def test_an_effect_that_the_encoder_has_not(bench: Bench) -> None:
    with pytest.raises(BadInput, match=r"mismatch\.ghost: "):
        true_camera(bench, {"ghost": {"fraction": 0.1}})
