"""Sessions: patterns, scenes and captures as asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Acquisition, Session, VirtualCamera
from sci_lightning.virtual_camera.scene import structural


def test_the_default_is_34_captures() -> None:
    session = Session()
    assert sum(session.counts.values()) == 34
    assert (session.size, session.frames, session.bit_depth) == ((128, 128), 8, 8)


@pytest.mark.parametrize(("bits", "frames"), [(1, 4), (2, 8), (4, 8), (4, 2), (8, 16)])
def test_structural_patterns(bits, frames):
    patterns = structural(np.random.default_rng(0), frames, (20, 30), bits)
    assert patterns.shape == (frames, 20, 30)
    np.testing.assert_array_equal(patterns.sum(0), 1)
    assert set(np.unique(patterns * 2**bits)) <= set(range(2**bits)) | ({2} if bits == 1 else set())
    assert patterns.std(0).mean() > 0.03


@pytest.mark.parametrize("mask", ["structural", "binary"])
@pytest.mark.parametrize(("size", "frames", "bit_depth"), [((17, 31), 4, 10), ((16, 16), 16, 12), ((33, 20), 5, 8)])
def test_any_size(mask, size, frames, bit_depth):
    session = Session(size=size, frames=frames, bit_depth=bit_depth, mask=mask, flat=1, static=1, dynamic=1, unknown=1)
    captures = VirtualCamera(session, {"mask_rotation": {"angle": 1.0}}).capture(2)
    count = 4 + 1 + 2 + 2 + frames + 1 + 1 + 1
    assert captures.measurement.shape == (count, *size)
    assert captures.measurement.dtype == (np.uint8 if bit_depth == 8 else np.uint16)
    assert captures.measurement.max() < 2**bit_depth
    assert captures.patterns.shape == (frames + 2, *size)
    assert captures.scene.shape == (count, frames, *size) and captures.scene.dtype == np.float32
    assert np.isnan(captures.scene[-1]).all() and np.isfinite(captures.scene[:-1]).all()
    assert np.nanmin(captures.scene) >= 0 and np.nanmax(captures.scene) <= 1


def test_kinds() -> None:
    acquisition = Session(size=(16, 16), frames=4, dark_exposures=(1.0, 4.0)).acquisition(0)
    assert set(acquisition.kind) == {"dark", "flat", "pattern", "static", "dynamic"}
    by_kind = {kind: np.array(acquisition.kind) == kind for kind in acquisition.kind}
    assert acquisition.scene[by_kind["dark"]].max() == 0
    np.testing.assert_array_equal(acquisition.exposure[by_kind["dark"]], [1, 4, 1, 4])
    assert np.ptp(acquisition.scene[by_kind["static"]], axis=1).max() == 0
    assert (np.ptp(acquisition.scene[by_kind["dynamic"]], axis=1).max((1, 2)) > 0.1).all()
    single = acquisition.sequence[by_kind["pattern"]][-4:]  # pattern t in slot t, all off in the others
    np.testing.assert_array_equal(single, np.where(np.eye(4, dtype=bool), np.arange(4), 4))
    bare = Session(size=(16, 16), dark=0, flat=0, all_on=0, all_off=0, pattern=0, static=0, dynamic=3).acquisition(0)
    assert bare.kind == ("dynamic",) * 3


def test_white_just_fills_the_range() -> None:
    for mask in ("structural", "binary"):
        acquisition = Session(size=(64, 64), mask=mask).acquisition(0)
        full = acquisition.patterns[:8].sum(0).mean() * acquisition.aperture[-1]
        assert full == pytest.approx(1, rel=0.01)


def test_patterns_of_a_file(tmp_path: Path) -> None:
    patterns = np.random.default_rng(0).random((3, 16, 20))
    np.save(tmp_path / "mask.npy", patterns)
    session = Session(size=(16, 20), frames=3, mask=str(tmp_path / "mask.npy"))
    np.testing.assert_allclose(session.acquisition(0).patterns[:3], patterns, atol=1e-7)
    with pytest.raises(BadInput, match=r"\(3, 16, 20\).*4 patterns of 16 x 20"):
        Session(size=(16, 20), frames=4, mask=session.mask).acquisition(0)
    np.save(tmp_path / "mask.npy", patterns * 2)
    with pytest.raises(BadInput, match=r"\[0, 1\]"):
        session.acquisition(0)
    (tmp_path / "mask.npy").write_bytes(b"no array")
    with pytest.raises(BadInput, match="not a readable"):
        session.acquisition(0)
    with pytest.raises(BadInput, match="no such file"):
        Session(mask="solid").acquisition(0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"size": (12, 64)}, "size must be a whole number from 16"),
        ({"size": (64,)}, "height and width"),
        ({"frames": 1}, "frames"),
        ({"bit_depth": 7}, "bit_depth must be a whole number from 8 to 16"),
        ({"bits": 0}, "bits"),
        ({"dark": -1}, "dark"),
        ({"static": 1.5}, "static"),
        ({"dark": 0, "flat": 0, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 0}, "no captures"),
        ({"aperture": 0}, "aperture"),
        ({"full_well_e": 0}, "full_well_e must be a positive number"),
        ({"read_noise_dn": -1}, "read_noise_dn must be a number of 0 or more"),
        ({"dark_exposures": ()}, "dark_exposures"),
        ({"oversampling": 0}, "oversampling"),
        ({"surround": "white"}, "goes_on, dark or edge"),
    ],
)
def test_wrong_sessions(wrong, message):
    with pytest.raises(BadInput, match=message):
        Session(**wrong)


def test_an_acquisition_that_does_not_fit() -> None:
    fitting = {
        "patterns": np.zeros((4, 16, 16)),
        "sequence": np.zeros((2, 4), int),
        "scene": np.zeros((2, 4, 16, 16)),
        "aperture": np.ones(2),
        "exposure": np.ones(2),
        "kind": ("dark", "dark"),
    }
    Acquisition(**fitting)
    for name, value in (("scene", np.zeros((2, 3, 16, 16))), ("sequence", np.full((2, 4), 4)), ("kind", ("dark",))):
        with pytest.raises(BadInput, match=name):
            Acquisition(**{**fitting, name: value})


@pytest.mark.parametrize("mask", ["structural", "binary", "file"])
def test_the_world_goes_on_beyond_the_field(mask: str, tmp_path: Path) -> None:
    """Patterns and scenes continue; what the file states does not depend on it, and light enters from there."""
    np.save(tmp_path / "mask.npy", np.random.default_rng(0).random((3, 16, 20)))
    told = str(tmp_path / "mask.npy") if mask == "file" else mask
    session, dark = (Session(size=(16, 20), frames=3, mask=told, surround=word) for word in ("goes_on", "dark"))
    taken, alone = session.acquisition(2), dark.acquisition(2)
    for name in ("patterns", "scene"):
        np.testing.assert_array_equal(getattr(taken, name), getattr(alone, name))
    world = taken.world
    assert world is not None and alone.world is None
    inside = (..., slice(world.border, -world.border), slice(world.border, -world.border))
    np.testing.assert_array_equal(world.patterns[inside], taken.patterns)
    np.testing.assert_array_equal(world.scene[inside], taken.scene)
    beyond = world.patterns[:3, : world.border]
    assert 0 <= beyond.min() < beyond.max() <= 1 and beyond.std() > 0.05
    shown = {one: VirtualCamera(one, {"mask_shift": {"dx": 3.0}}).capture(2) for one in (session, dark)}
    lit = [captures.measurement[4:10, :, :3].mean() for captures in shown.values()]
    assert lit[0] > 20 and lit[1] < 2
    np.testing.assert_array_equal(shown[session].scene, shown[dark].scene)
    assert [captures.surround for captures in shown.values()] == ["unknown", "dark"]
