"""The plan of a session: what it lists can be recorded, packed and diagnosed without a further word."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from skimage.io import imread, imsave

from sci_lightning.captures import read_captures
from sci_lightning.captures.pack import pack_captures
from sci_lightning.captures.plan import read_coding_patterns
from sci_lightning.captures.registration import register as find_homography
from sci_lightning.captures.registration.registration import read_unregistered, write_homography
from sci_lightning.cli.commands import captures as command_line
from sci_lightning.errors import BadInput

SMALL = ("frames=4", "size=[32,40]")


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Runs ``captures plan`` in an empty folder; returns what it printed, or its line and status."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)

    def run(*words: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["captures", "plan", *words])
        try:
            command_line.main()
        except SystemExit as stop:
            return int(stop.code or 0), capsys.readouterr().err
        return 0, capsys.readouterr().out

    return run


def record(folder: Path, pixels: int = 1) -> None:
    """Record what the recipe lists with a camera that is ideal but for its read noise; shares no code with the plan.

    A mirror is so many ``pixels`` wide and high.
    """
    recipe = yaml.safe_load((folder / "captures.yaml").read_text())
    random = np.random.default_rng(1)
    patterns = np.stack([imread(path) for path in sorted((folder / "patterns").glob("slot_*.png"))]) / 255
    patterns = patterns.repeat(pixels, 1).repeat(pixels, 2)
    words = {"all_off": np.zeros_like(patterns[0]), "all_on": np.ones_like(patterns[0])}
    for entry in recipe["captures"]:
        sequence = entry.get("sequence", list(range(len(patterns))))
        sequence = [sequence] * len(patterns) if isinstance(sequence, str) else sequence
        shown = sum(words[slot] if isinstance(slot, str) else patterns[slot] for slot in sequence)
        scene = imread(folder / entry["scene"]) / 255 if isinstance(entry["scene"], str) else entry["scene"]
        for number in range(5 if entry["kind"] == "dark" else 1):
            dn = 255 * entry.get("aperture", 1) * shown * scene + random.normal(0, 0.8, patterns[0].shape) + 2
            name = entry["measurement"].replace("*", str(number + 1))
            imsave(folder / name, np.clip(np.round(dn), 0, 255).astype(np.uint8), check_contrast=False)


@pytest.mark.slow
def test_mirrors_that_are_not_pixels(plan, tmp_path: Path) -> None:
    """Targets are of the camera's size, and the mirrors are registered before the folder is packed."""
    status, printed = plan("LAB", "frames=4", "size=[32,40]", "field=[96,120]", "target=2")
    lab = tmp_path / "LAB"
    assert status == 0 and "captures register LAB" in printed
    assert imread(lab / "targets" / "target_1.png").shape == (96, 120)
    assert imread(lab / "patterns" / "slot_00.png").shape == (32, 40)
    text = (lab / "plan.md").read_text()
    assert "captures of 96 x 120 pixels behind 32 x 40 mirrors, 4 slots" in text
    assert "5. The mirrors are not the camera's pixels" in text and "6. Change `captures.yaml`" in text
    record(lab, pixels=3)
    write_homography(lab, find_homography(read_unregistered(lab), perspective=False).matrix)
    packed = pack_captures(lab, tmp_path / "lab.h5")
    assert packed.size == (96, 120) and packed.mirrors == (32, 40)
    assert packed.sensor_to_modulator is not None
    np.testing.assert_allclose(
        packed.sensor_to_modulator, [[1 / 3, 0, -1 / 3], [0, 1 / 3, -1 / 3], [0, 0, 1]], atol=0.02
    )

    status, printed = plan("OTHER", "field=[96]")
    assert status == 2 and "field=[96]: expected" in printed
    assert not (tmp_path / "OTHER").exists()


def test_recorded_and_packed(plan, tmp_path: Path) -> None:
    status, printed = plan("LAB", *SMALL, "read_noise_dn=0.8", "full_well_e=10000")
    assert status == 0 and "36 captures to record, 28 settings" in printed and "captures pack LAB out=lab.h5" in printed
    lab = tmp_path / "LAB"
    with pytest.raises(BadInput, match=r"no file fits 'shots/dark_\*\.tif' in"):
        pack_captures(lab, tmp_path / "lab.h5")
    record(lab)
    warned: list[str] = []
    captures = pack_captures(lab, tmp_path / "lab.h5", on_warning=warned.append)
    assert not warned
    assert len(captures) == 36 and captures.size == (32, 40) and captures.read_noise_dn == 0.8
    kinds = read_captures(tmp_path / "lab.h5").kind
    assert {kind: kinds.count(kind) for kind in kinds} == {"dark": 10, "flat": 11, "pattern": 9, "static": 6}
    assert sorted(set(captures.exposure)) == [1, 4]
    text = (lab / "plan.md").read_text()
    assert text.count("`shots/") == 28 + 2 and "should read about 242 of 255 DN" in text


def test_own_mask(plan, tmp_path: Path) -> None:
    mask = np.random.default_rng(0).integers(0, 16, (4, 20, 24)) / 16
    np.save(tmp_path / "mask.npy", mask)
    assert plan("LAB", "mask=mask.npy", "target=0", "long_dark=0", "dark=2")[0] == 0
    shown = np.stack([imread(path) for path in sorted((tmp_path / "LAB" / "patterns").glob("slot_*.png"))])
    assert np.abs(shown / 255 - mask).max() <= 0.5 / 255 + 1e-9
    assert not (tmp_path / "LAB" / "targets").exists()
    assert "dark: fewer than 5 captures" in (tmp_path / "LAB" / "plan.md").read_text()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("dark=-1",), "dark=-1"),
        (("flat=100000",), "captures besides those of single patterns, expected 1 to 1,000"),
        (("mask=none.npy",), "none.npy: no such file"),
        (("mask=flat.npy",), "flat.npy: expected a numeric array of 3 dimensions"),
        (("mask=nan.npy",), "nan.npy: the mask holds NaN"),
        (("mask=bright.npy",), "bright.npy: mask values must lie in [0, 1]"),
        (("mask=dark.npy",), "pattern 1 is dark everywhere"),
        (("bit_depth=40",), "bit_depth=40"),
    ],
)
def test_refuses(plan, tmp_path: Path, words: tuple[str, ...], expected: str) -> None:
    for name, patterns in {
        "flat": np.ones((8, 8)),
        "nan": np.full((2, 8, 8), np.nan),
        "bright": np.full((2, 8, 8), 2.0),
        "dark": np.stack((np.ones((8, 8)), np.zeros((8, 8)))),
    }.items():
        np.save(tmp_path / f"{name}.npy", patterns)
    status, line = plan("LAB", *SMALL, *words)
    assert status == 2 and expected in line and line.count("\n") == 1
    assert not (tmp_path / "LAB").exists() and not list(tmp_path.glob(".LAB*"))


def test_recordings_are_never_lost(plan, tmp_path: Path) -> None:
    (tmp_path / "LAB" / "shots").mkdir(parents=True)
    (tmp_path / "LAB" / "shots" / "dark_1.tif").write_bytes(b"recorded")
    status, line = plan("LAB", *SMALL)
    assert status == 2 and "LAB: is there already; name a new folder" in line
    assert (tmp_path / "LAB" / "shots" / "dark_1.tif").read_bytes() == b"recorded"


def test_pictures_of_whole_levels(tmp_path: Path) -> None:
    imsave(
        tmp_path / "mask.tif",
        np.stack([np.full((8, 8), level, np.uint8) for level in (0, 51, 255)]),
        check_contrast=False,
    )
    assert read_coding_patterns(tmp_path / "mask.tif")[:, 0, 0] == pytest.approx([0, 0.2, 1])
    np.save(tmp_path / "mask.npy", np.arange(256).reshape(2, 8, 16))  # NumPy's own whole numbers have 64 bits
    assert read_coding_patterns(tmp_path / "mask.npy").max() == 1


def test_the_current_folder_is_none_to_be_made(plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    status, line = plan(".", *SMALL)
    assert status == 2 and "is the current folder; name a new one" in line
