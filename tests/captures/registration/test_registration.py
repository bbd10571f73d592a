"""Registrations of modulators: hidden homographies are found, and what cannot be registered is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from sci_lightning.captures import Captures, pack_captures, read_captures, write_captures
from sci_lightning.captures.registration import register
from sci_lightning.captures.registration.registration import read_unregistered, write_homography
from sci_lightning.errors import BadInput
from sci_lightning.homography import on_modulator
from tests.own_grid_camera import Deviation, captures, homography

SIZE, MIRRORS = (48, 56), (60, 64)


def furthest(result: np.ndarray, hidden: np.ndarray, size: tuple[int, int] = SIZE) -> float:
    """Largest distance in pixels between where two homographies say that a mirror is seen, over the field."""
    y, x = np.meshgrid(np.linspace(0, size[0] - 1, 5), np.linspace(0, size[1] - 1, 5))
    u, v = on_modulator(hidden, x, y)
    inverse = np.linalg.inv(result)
    back = on_modulator(inverse / inverse[2, 2], u, v)
    return float(np.hypot(back[0] - x, back[1] - y).max())


@pytest.mark.parametrize(
    ("matrix", "known", "pitch"),
    [
        (homography((1.3, 1.3), 2.0, SIZE, MIRRORS, offset=(4.3, -3.1)), True, (1.4, 1.2)),
        (homography((0.75, 0.75), 30.0, SIZE, MIRRORS), True, (0.75, 0.75)),
        pytest.param(homography((1.6, 1.5), 183.0, SIZE, MIRRORS, mirrored=True), False, None, marks=pytest.mark.slow),
        pytest.param(
            homography((3.2, 1.6), -1.0, SIZE, MIRRORS, tilt=(0.02, -0.01)), False, None, marks=pytest.mark.slow
        ),
        pytest.param(homography((1.4, 1.4), 45.0, SIZE, MIRRORS), True, None, marks=pytest.mark.slow),
        pytest.param(homography((0.9, 0.9), 91.0, SIZE, MIRRORS), True, None, marks=pytest.mark.slow),
    ],
    ids=[
        "turned",
        "a field that sees beyond the modulator",
        "mirrored, unknown scenes",
        "diamond array, unknown scenes",
        "at 45 degrees",
        "a quarter turn",
    ],
)
def test_hidden_homography(matrix: np.ndarray, known: bool, pitch: tuple[float, float] | None) -> None:
    """It is found to a tenth of a pixel wherever the field sees; rotation, place and (slow) pitch are unknown."""
    seen = captures(matrix, size=SIZE, mirrors=MIRRORS, known=known, sensor_to_modulator=None)
    if not known:
        seen = seen.take(range(3, 12))  # all of even targets
    result = register(seen, pitch=pitch)
    assert furthest(result.matrix, matrix) < 0.1
    assert result.residual < 0.15 and result.correlation > 0.7


@pytest.mark.parametrize("perspective", [True, False])
def test_lens_distortion_does_not_bend_the_homography(perspective: bool) -> None:
    """It is fitted beside the homography, which is then as right as without it; the residual tells of it."""
    matrix = homography((1.3, 1.3), 2.0, SIZE, MIRRORS)
    bent = captures(matrix, Deviation(barrel=-0.08), SIZE, MIRRORS, sensor_to_modulator=None)
    result = register(bent.take(range(8, 12)), perspective, pitch=(1.3, 1.3))
    assert result.distortion == pytest.approx(-0.08, abs=0.003) and 0.3 < result.residual < 2
    assert furthest(result.matrix, matrix) < 0.05


@pytest.fixture
def one() -> Captures:
    matrix = homography((1.3, 1.3), 2.0, SIZE, MIRRORS)
    return captures(matrix, size=SIZE, mirrors=MIRRORS, sensor_to_modulator=None).take(range(12))


@pytest.mark.slow
def test_without_contrast(one: Captures) -> None:
    flat = one.take([3, 6, 7])
    with pytest.raises(BadInput, match=r"every pattern .*even target .*same everywhere"):
        register(replace(flat, sequence=np.full_like(flat.sequence, 5)))
    with pytest.raises(BadInput, match="no pattern is shown to an even target"):
        register(one.take([0, 1, 2]))
    noise = np.random.default_rng(0).integers(90, 110, one.measurement.shape).astype(np.uint8)
    with pytest.raises(BadInput, match=r"best correlation 0"):
        register(replace(one, measurement=noise), pitch=(1.3, 1.3))
    said: list[str] = []
    unknown = replace(one, measurement=noise, scene=np.full_like(one.scene, np.nan))
    with pytest.raises(BadInput, match="no pattern can be found"):
        register(unknown, pitch=(1.3, 1.3), on_progress=said.append)
    assert "the unknown scenes of captures" in said[0] and "are taken for even ones" in said[0]


def test_a_bad_homography_is_found_anew(one: Captures, tmp_path: Path) -> None:
    file = tmp_path / "a.h5"
    write_captures(file, replace(one, sensor_to_modulator=homography((1.3, 1.3), 2.0, SIZE, MIRRORS)))
    with h5py.File(file, "a") as stored:
        stored.attrs["sensor_to_modulator"] = homography((1.3, 1.3), 2.0, SIZE, MIRRORS, offset=(500.0, 0.0))
    with pytest.raises(BadInput, match="off the modulator"):
        read_captures(file)
    assert len(read_unregistered(file, again=True)) == len(one)


def test_into_a_file(one: Captures, tmp_path: Path) -> None:
    """The file is refused for a diagnosis before, and registered afterwards; nothing else in it changes."""
    file = tmp_path / "a.h5"
    write_captures(file, one)
    with h5py.File(file, "a") as stored:
        stored.attrs["lab"] = "book 3"
    with pytest.raises(BadInput, match=r"'patterns' .*6, 60, 64.*captures register"):
        read_captures(file)
    matrix = homography((1.3, 1.3), 2.0, SIZE, MIRRORS)
    assert write_homography(file, matrix) == file
    registered = read_captures(file)
    assert np.array_equal(registered.sensor_to_modulator, matrix) and np.array_equal(registered.patterns, one.patterns)
    with h5py.File(file) as stored:
        assert stored.attrs["lab"] == "book 3"
    with pytest.raises(BadInput, match=r"has a homography already .*again=true"):
        read_unregistered(file)
    before = file.read_bytes()
    with pytest.raises(BadInput, match="singular"):
        write_homography(file, np.zeros((3, 3)))
    assert file.read_bytes() == before and list(tmp_path.iterdir()) == [file]
    assert read_unregistered(file, again=True).mirrors == MIRRORS


@pytest.mark.parametrize("style", ["block", "braces"])
def test_into_a_folder(one: Captures, style: str, tmp_path: Path) -> None:
    np.save(tmp_path / "masks.npy", one.patterns[:4])
    np.save(tmp_path / "shots.npy", one.measurement[8:])
    recipe = {
        "bit_depth": 8,
        "patterns": ["masks.npy", "all_off", "all_on"],
        "captures": [{"measurement": "shots.npy", "scene": 0.9, "sequence": [0, "all_off", "all_off", "all_off"]}],
    }
    text = yaml.safe_dump(recipe, default_flow_style=style == "braces", sort_keys=False)
    (tmp_path / "captures.yaml").write_text("# our lab\n" + text)
    with pytest.raises(BadInput, match=r"patterns .*\(60, 64\); .*captures register"):
        pack_captures(tmp_path, tmp_path / "a.h5")
    assert read_unregistered(tmp_path).sensor_to_modulator is None
    matrix = homography((1.3, 1.3), 2.0, SIZE, MIRRORS)
    for _ in range(2):
        write_homography(tmp_path, matrix)
    written = (tmp_path / "captures.yaml").read_text()
    assert written.count("sensor_to_modulator") == 1 and written.startswith("# our lab") == (style == "block")
    packed = pack_captures(tmp_path, tmp_path / "a.h5")
    assert packed.sensor_to_modulator is not None and np.allclose(packed.sensor_to_modulator, matrix, rtol=1e-14)
    (tmp_path / "captures.yaml").write_text(text + "\nsensor_to_modulator: [[1, 0], [0, 1]]\n" * (style == "block"))
    if style == "block":
        with pytest.raises(BadInput, match=r"sensor_to_modulator: .*three rows"):
            pack_captures(tmp_path, tmp_path / "a.h5")


@pytest.mark.parametrize(
    "earlier",
    [
        "sensor_to_modulator: [[1, 0, 0],   # of May\n  [0, 1, 0],\n  [0, 0, 1]]\n",
        "sensor_to_modulator:\n- [1, 0, 0]\n- [0, 1, 0]\n- [0, 0, 1]\n",
    ],
)
def test_a_matrix_of_several_lines_is_replaced_and_nothing_else(one: Captures, earlier: str, tmp_path: Path) -> None:
    np.save(tmp_path / "masks.npy", one.patterns[:4])
    np.save(tmp_path / "shots.npy", one.measurement[8:])
    rest = "# our lab\nbit_depth: 8   # the old camera\npatterns: [masks.npy]\n"
    last = "captures:   # of Monday\n- {measurement: shots.npy, scene: 0.9}\n"
    (tmp_path / "captures.yaml").write_text(rest + earlier + last)
    write_homography(tmp_path, homography((1.3, 1.3), 2.0, SIZE, MIRRORS))
    written = (tmp_path / "captures.yaml").read_text()
    assert written.startswith(rest + last + "sensor_to_modulator: [[") and written.count("sensor_to_modulator") == 1
