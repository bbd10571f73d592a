"""``diagnose measurement=``: files as people have them, with a mask or without one, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from tests.conftest import members
from tests.files.formats import check

Ran = Callable[..., str]
Refused = Callable[..., str]


@pytest.fixture
def snapshot(tmp_path: Path) -> np.ndarray:
    """A snapshot of a smooth scene behind a random mask of four slots; both are written as .mat files."""
    random = np.random.default_rng(0)
    mask = random.integers(0, 2, (64, 64, 4)).astype(np.uint8)
    y, x = np.mgrid[0:64, 0:64]
    light = 50 * mask.sum(2) * (0.6 + 0.3 * np.sin(x / 9) * np.cos(y / 7))
    dn = np.clip(np.round(light + 12 + random.standard_normal((64, 64))), 0, 255).astype(np.uint8)
    savemat(tmp_path / "meas.mat", {"meas": dn})
    savemat(tmp_path / "mask.mat", {"mask": mask})
    return dn


def test_without_a_mask(snapshot: np.ndarray, tmp_path: Path, ran: Ran) -> None:
    said = ran("diagnose", "measurement=meas.mat", "out=found")
    assert "1 snapshot of 64 x 64 pixels, 8 bits" in said and "give mask=FILE" in said
    content = json.loads((tmp_path / "found" / "snapshots.json").read_text())
    check("snapshots", content)
    assert content["file"] == "meas.mat" and content["levels"]["highest"] == snapshot.max()
    assert not (tmp_path / "found" / "report.json").exists()


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ([], "captures=FILE.h5, or measurement=FILE mask=FILE"),
        (["captures=a.h5", "measurement=meas.mat"], "one of the two"),
        (["measurement=nothing.mat"], "nothing.mat: no such file"),
        (["measurement=meas.mat", "mask=none.mat"], "none.mat: no such file"),
        (["measurement=meas.mat", "mask=large.mat"], "mask_origin=[5,9]"),
        (["measurement=meas.mat", "mask=closed.mat"], "never opens"),
        (["measurement=meas.mat", "mask=open.mat"], "is the same everywhere"),
        (["measurement=meas.mat", "mask=nan.mat"], "holds NaN"),
        (["measurement=folder"], "folder: is a folder, expected a file"),
        (["measurement=meas.mat", "mask=folder"], "folder: holds no picture"),
        (
            ["measurement=meas.mat", "mask=mask.mat", "verification=[0]"],
            "sets all 1 captures of unknown scenes aside",
        ),
        (["measurement=meas.mat", "bit_depth=4"], "do not fit into 4 bits"),
        (["measurement=meas.mat", "mask=mask.mat", "verification=[1]"], "numbered from 0 to 0"),
        (["measurement=meas.mat", "mask=mask.mat", "mask_step=[0,2,1]"], "mask_step"),
        (["captures=a.h5", "mask=mask.mat"], "mask=mask.mat: belongs to measurement="),
        (["captures=a.h5", "verification=[0]"], "verification=[0]: belongs to measurement="),
        (["measurement=meas.mat", "mask_step=[0,2]"], "mask_step=[0, 2]: belongs to a mask; give mask=FILE"),
        (["measurement=several.mat"], "several.mat: no array named 'meas'; the file holds"),
        (["measurement=holes.npy"], "holes.npy: NaN in snapshot 1, row 2, column 3"),
        (["measurement=small.npy"], "small.npy: snapshots (1) of 9 x 40 pixels are too small"),
        (["measurement=flat.npy"], "flat.npy: expected a numeric array of 2 or 3 dimensions"),
    ],
)
def test_bad_input(words: list[str], answer: str, snapshot: np.ndarray, tmp_path: Path, refused: Refused) -> None:
    mask = np.random.default_rng(0).integers(0, 2, (64, 64, 4))
    large = np.random.default_rng(1).integers(0, 2, (80, 90, 4))
    large[5:69, 9:73] = mask
    savemat(tmp_path / "large.mat", {"mask": large})
    savemat(tmp_path / "open.mat", {"mask": np.ones((64, 64, 4))})
    savemat(tmp_path / "nan.mat", {"mask": np.full((64, 64, 4), np.nan)})
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.h5").touch()
    savemat(tmp_path / "several.mat", {"y": mask, "dark": mask[..., :2], "positions": mask[:20, :30, 0]})
    np.save(tmp_path / "holes.npy", np.where(np.arange(2 * 32 * 32).reshape(2, 32, 32) == 1024 + 67, np.nan, 5.0))
    np.save(tmp_path / "small.npy", np.ones((9, 40), np.uint8))
    np.save(tmp_path / "flat.npy", np.ones(40, np.uint8))
    savemat(tmp_path / "closed.mat", {"mask": np.zeros((64, 64, 4))})
    assert answer in refused("diagnose", *words, "out=found")
    assert not (tmp_path / "found" / "report.json").exists() and not (tmp_path / "found" / "snapshots.json").exists()


def test_a_part_of_the_snapshots_is_reconstructed(snapshot: np.ndarray, tmp_path: Path, ran: Ran) -> None:
    """Where the mask covers a part of the snapshots, that part is kept, and the corrected camera decodes it."""
    savemat(tmp_path / "part.mat", {"mask": loadmat(tmp_path / "mask.mat")["mask"][4:, :58]})
    left_out = sorted(set(members("effect")) - {"mask_contrast", "mask_shift", "read_noise", "shot_noise"})
    words = ["measurement=meas.mat", "mask=part.mat", "mask_origin=[-4,0]", f"leave_out=[{','.join(left_out)}]"]
    said = ran("diagnose", *words, "out=found")
    assert "found/covered_snapshots.npy: the 60 x 58 pixels" in said
    assert np.array_equal(np.load(tmp_path / "found" / "covered_snapshots.npy")[0], snapshot[4:, :58])
    assert (tmp_path / "found" / "snapshots.json").is_file()
    camera = ["decoder=gap_tv", "decoder.iterations=[2]", "decoder.camera=found/encoder.yaml"]
    ran("reconstruct", *camera, "measurement=found/covered_snapshots.npy", "out=video")
    assert list((tmp_path / "video").iterdir())


def test_a_second_diagnosis_leaves_nothing_of_the_first(snapshot: np.ndarray, tmp_path: Path, ran: Ran) -> None:
    """A folder holds the files of one diagnosis, and what is nobody's diagnosis is not overwritten."""
    out = tmp_path / "found"
    out.mkdir()
    for name in ("report.json", "report.html", "encoder.yaml", "effective_mask.npy", "prediction.png"):
        (out / name).write_text("of an earlier diagnosis")
    (out / "notes.txt").write_text("mine")
    ran("diagnose", "measurement=meas.mat", "out=found")
    assert {path.name for path in out.iterdir() if path.is_file()} <= {"snapshots.json", "notes.txt", "diagnose.log"}
    assert (out / "notes.txt").read_text() == "mine"
    assert not list(out.glob(".report-*"))


def test_a_file_of_somebody_else_is_kept(snapshot: np.ndarray, tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "encoder.yaml").write_text("mine")
    line = refused("diagnose", "measurement=meas.mat", "out=found")
    assert "found: holds encoder.yaml" in line
    assert (tmp_path / "found" / "encoder.yaml").read_text() == "mine"


def test_what_was_diagnosed_is_kept(snapshot: np.ndarray, tmp_path: Path, ran: Ran) -> None:
    """A snapshot that lies in the folder under the name of a diagnosis's file is the user's."""
    (tmp_path / "found").mkdir()
    np.save(tmp_path / "found" / "covered_snapshots.npy", snapshot)
    ran("diagnose", "measurement=found/covered_snapshots.npy", "out=found")
    assert np.array_equal(np.load(tmp_path / "found" / "covered_snapshots.npy"), snapshot)
