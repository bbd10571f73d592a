"""What snapshots tell without a mask is what was put in, and nothing where nothing was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from sci_lightning.diagnosis.blind.snapshot_facts import snapshot_facts, still_needed
from sci_lightning.errors import BadInput


def scenes(count: int, size: tuple[int, int] = (160, 192), seed: int = 0) -> np.ndarray:
    """Smooth scenes behind a random mask of eight slots, from 0 to 1; code of their own, and none of the encoder's."""
    random = np.random.default_rng(seed)
    total = random.integers(0, 2, (8, *size)).sum(0) / 8
    y, x = np.mgrid[0 : size[0], 0 : size[1]]
    images = [
        0.5 + 0.45 * np.sin(x / random.uniform(9, 30) + random.uniform(0, 6)) * np.cos(y / random.uniform(9, 30))
        for _ in range(count)
    ]
    return np.stack(images) * total


def record(light: np.ndarray, black: float = 0, read: float = 1.0, well: float = 20000, bits: int = 12) -> np.ndarray:
    random = np.random.default_rng(1)
    full = 2**bits - 1
    electrons = random.poisson(light * well)
    dn = electrons / well * full + black + read * random.standard_normal(light.shape)
    return np.clip(np.round(dn), 0, full).astype(np.uint16)


def test_nothing_wrong() -> None:
    facts = snapshot_facts(record(0.8 * scenes(4), black=40), 12)
    assert not facts.rows.significant and not facts.columns.significant
    assert facts.defects.hot == facts.defects.dark == 0 and facts.defects.decided
    assert facts.codes.missing == 0 and facts.codes.step == 1
    assert facts.levels.saturates_at is None and max(facts.levels.at_full_scale) == 0
    assert facts.levels.black_level is None or abs(facts.levels.black_level - 40) < 5


def test_black_level_from_dark_pixels() -> None:
    light = scenes(3)
    light[:, :, :20] = 0
    facts = snapshot_facts(record(light, black=61.3, read=2), 12)
    assert facts.levels.black_level == pytest.approx(61.3, abs=2)
    assert "black level near 6" in facts.sentences()[0]
    assert snapshot_facts(record(light, black=0), 12).levels.black_level == 0


def test_saturation() -> None:
    dn = record(1.4 * scenes(3))
    facts = snapshot_facts(dn, 12)
    assert max(facts.levels.at_full_scale) > 0.001 and any("saturated (4095" in text for text in facts.sentences())
    facts = snapshot_facts(np.minimum(dn, 3000), 12)
    assert facts.levels.saturates_at == 3000 and any("pile up at 3000" in text for text in facts.sentences())


def test_a_single_brightest_pixel_is_no_saturation() -> None:
    dn = record(scenes(1))[:, :64, :64]
    dn[0, 20, 20] = dn.max() + 40
    assert snapshot_facts(dn, 12).levels.saturates_at is None


def test_missing_codes() -> None:
    dn = record(0.9 * scenes(3), read=3, bits=8, well=4000)
    clean = snapshot_facts(dn, 8)
    assert clean.codes.missing == 0
    missing = dn.copy()
    missing[missing % 16 == 5] += 1
    facts = snapshot_facts(missing, 8)
    assert 8 <= facts.codes.missing <= 16 and "never occur" in " ".join(facts.sentences())
    assert snapshot_facts(dn // 4 * 4, 8).codes.step == 4


def test_defects() -> None:
    dn = record(0.6 * scenes(4), black=30)
    dn[:, 20, 33] = 4000
    dn[:, 100, 7] = 3500
    facts = snapshot_facts(dn, 12)
    assert facts.defects.hot == 2 and facts.defects.places == ((20, 33), (100, 7))
    assert any("2 hot pixels" in text for text in facts.sentences())
    assert not snapshot_facts(dn[:1], 12).defects.decided


@pytest.mark.parametrize("axis", ["rows", "columns"])
def test_fixed_lines(axis: str) -> None:
    dn = record(0.6 * scenes(4), black=100).astype(float)
    offsets = 20 * np.random.default_rng(3).standard_normal(dn.shape[1 if axis == "rows" else 2])
    dn += offsets[:, None] if axis == "rows" else offsets
    facts = snapshot_facts(np.clip(np.round(dn), 0, 4095).astype(np.uint16), 12)
    seen, other = (facts.rows, facts.columns) if axis == "rows" else (facts.columns, facts.rows)
    assert seen.significant and seen.std == pytest.approx(20, rel=0.3)
    assert not other.significant
    assert any(f"fixed {axis}" in text for text in facts.sentences())


def test_noise_of_a_repeated_snapshot() -> None:
    light = np.repeat(0.9 * scenes(1), 2, 0)
    light[:, :, :30] = 0  # the black level shows
    facts = snapshot_facts(record(light, black=50, read=4, well=8000), 12)
    assert facts.noise.source == "repeated"
    assert facts.noise.read_noise_dn == pytest.approx(4, rel=0.4)
    assert facts.noise.full_well_e == pytest.approx(8000, rel=0.15)
    assert not any("two snapshots" in text for text in still_needed(facts, True, True))


def test_noise_of_smooth_blocks_is_a_bound() -> None:
    facts = snapshot_facts(record(scenes(2) / 8 * 8, read=4), 12)
    assert facts.noise.source == "smooth" and min(facts.noise.deviations) > 2
    assert "the smoothest blocks" in facts.noise.sentence()


@pytest.mark.parametrize("read", [3.0, 20.0])
def test_noise_of_nothing_but_noise_is_no_bound_below_it(read: float) -> None:
    """The least of many variances is less than all of them: of pure noise it must not count as the bound itself."""
    even = 1000 + read * np.random.default_rng(0).standard_normal((1, 256, 256))
    facts = snapshot_facts(np.round(even).astype(np.uint16), 12)
    assert facts.noise.source == "smooth"
    assert facts.noise.deviations == pytest.approx([read] * len(facts.noise.deviations), rel=0.12)


@pytest.mark.parametrize("bits", [1, 2, 3])
def test_snapshots_of_few_codes(bits: int) -> None:
    dn = np.random.default_rng(0).integers(0, 2**bits, (2, 32, 32)).astype(np.uint16)
    assert snapshot_facts(dn, bits).sentences()


def test_what_is_needed() -> None:
    facts = snapshot_facts(record(scenes(1)), 12)
    needed = " ".join(still_needed(facts, False, False))
    assert "give mask=FILE" in needed and "known scenes" in needed and "further snapshots" in needed
    with pytest.raises(BadInput, match="at least 16 x 16"):
        snapshot_facts(np.zeros((1, 8, 40), np.uint16), 8)
    with pytest.raises(BadInput, match=r"H x W x N: .*last axis"):
        snapshot_facts(np.zeros((40, 40, 5), np.uint16), 8)


def test_a_real_camera_without_a_mask(shared_data: Path) -> None:
    """The black level of the cacti_cr10 captures is 4 to 5 DN, as a look at the histogram says."""
    stack = loadmat(shared_data / "real" / "cacti_cr10" / "meas_duomino_cr_10.mat")["meas"]
    facts = snapshot_facts(np.moveaxis(stack, -1, 0)[:, ::2, ::2], 8)
    assert facts.levels.black_level == pytest.approx(4.7, abs=0.8)
    assert max(facts.levels.at_full_scale) < 1e-3
