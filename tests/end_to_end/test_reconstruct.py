"""``reconstruct``: which mask, which numbers, and what speaks against them."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from tifffile import imwrite

from tests.conftest import ROOT

QUICK = ["decoder=gap_tv", "decoder.iterations=[2]", "device=cpu", "out=run"]
SIDE = 64


@pytest.fixture
def camera(tmp_path: Path) -> np.ndarray:
    """``mask.npy``, and a snapshot taken with it of a scene that moves, in [0, 1]."""
    random = np.random.default_rng(0)
    mask = (random.random((4, SIDE, SIDE)) < 0.5).astype(np.float32)
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    scene = np.stack([0.5 + 0.4 * np.sin(6 * (x + 0.05 * t)) * np.cos(5 * y) for t in range(4)])
    np.save(tmp_path / "mask.npy", mask)
    return (mask * scene).sum(0) / 4


@pytest.fixture
def warnings(ran: Callable[..., str]) -> Callable[..., list[str]]:
    """Run ``reconstruct``; the lines that it warns with."""

    def run(*overrides: str) -> list[str]:
        captured: list[str] = []

        class Tee:
            def write(self, text: str) -> int:
                captured.append(text)
                return len(text)

            def flush(self) -> None:
                pass

        old, sys.stderr = sys.stderr, Tee()  # type: ignore[assignment]
        try:
            ran("reconstruct", *QUICK, *overrides)
        finally:
            sys.stderr = old
        return [line for line in "".join(captured).splitlines() if line.startswith("warning: ")]

    return run


def test_no_mask_is_invented(refused: Callable[..., str], camera: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "snapshot.npy", camera.astype(np.float32))
    for named in ([], ["encoder=lsw_sr", "seed=3"], ["decoder.camera=rbw_sr"]):
        line = refused("reconstruct", *QUICK, "measurement=snapshot.npy", "size=[64,64]", *named)
        assert "no snapshot can be decoded without" in line and "mask=FILE" in line and "ckpt_path=" in line
        ((page, heading),) = re.findall(r"(docs/\S+\.md), '(.+)', says", line)
        text = (ROOT / page).read_text()
        section = text[text.index(f"## {heading}\n") :].partition("\n")[2].partition("\n## ")[0]
        assert len(section.split()) <= 120
    assert not (tmp_path / "run" / "video.gif").exists()


def test_a_mask_that_a_file_says_is_one(warnings: Callable[..., list[str]], camera: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "snapshot.npy", camera.astype(np.float32))
    measured = ["encoder=rbw_osr", "encoder/mask=measured", "encoder.mask.file=mask.npy", "frames=4", "size=[64,64]"]
    assert warnings("measurement=snapshot.npy", *measured) == []
    (tmp_path / "encoder.yaml").write_text(
        "_target_: sci_lightning.encoder.Encoder\n"
        "mask: {_target_: sci_lightning.encoder.mask.Measured, file: mask.npy}\n"
        "sensor: {_target_: sci_lightning.encoder.sensor.ClipQuantise, bit_depth: 8}\naperture: 0.25\n"
    )
    for place in ("encoder", "decoder.camera"):
        assert warnings("measurement=snapshot.npy", f"{place}=encoder.yaml", "frames=4", "size=[64,64]") == []


def test_masks_that_cannot_be(refused: Callable[..., str], camera: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "snapshot.npy", camera.astype(np.float32))
    np.save(tmp_path / "dark.npy", np.zeros((4, SIDE, SIDE), np.float32))
    given = [*QUICK, "measurement=snapshot.npy"]
    line = refused("reconstruct", *given, "mask=mask.npy", "frames=8")
    assert "frames=8, but mask=mask.npy has 4 slots" in line
    assert "dark.npy: the mask never opens" in refused("reconstruct", *given, "mask=dark.npy")
    np.save(tmp_path / "single.npy", np.load(tmp_path / "mask.npy")[:1])
    assert "a single slot" in refused("reconstruct", *given, "mask=single.npy")


def test_one_of_two_masks_of_a_file(
    ran: Callable[..., str], refused: Callable[..., str], camera: np.ndarray, tmp_path: Path
) -> None:
    np.save(tmp_path / "snapshot.npy", camera.astype(np.float32))
    own = np.load(tmp_path / "mask.npy").transpose(1, 2, 0)
    savemat(tmp_path / "two.mat", {"before": own, "after": own[::-1]})
    given = [*QUICK, "measurement=snapshot.npy", "mask=two.mat"]
    assert "choose one with mask_key=NAME" in refused("reconstruct", *given)
    ran("reconstruct", *given, "mask_key=before")


def test_a_mask_that_does_not_belong(warnings: Callable[..., list[str]], camera: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "snapshot.npy", camera.astype(np.float32))
    mask = np.load(tmp_path / "mask.npy")
    assert warnings("measurement=snapshot.npy", "mask=mask.npy") == []
    np.save(tmp_path / "turned.npy", mask.transpose(0, 2, 1))
    (line,) = warnings("measurement=snapshot.npy", "mask=turned.npy")
    assert "snapshot.npy: the mask fits this snapshot better" in line
    np.save(tmp_path / "other.npy", (np.random.default_rng(1).random(mask.shape) < 0.5).astype(np.float32))
    (line,) = warnings("measurement=snapshot.npy", "mask=other.npy")
    assert "does not seem to belong to this snapshot" in line


@pytest.mark.parametrize(
    ("values", "kind", "overrides", "told"),
    [
        (4095, np.uint16, [], ""),
        (4095, np.uint16, ["full_scale=65535"], "full_scale=4095"),
        (255 * 4, np.uint16, ["full_scale=65535"], "full_scale=1023"),
        (4095, np.uint16, ["full_scale=4095"], ""),
        (65535, np.uint16, [], ""),
        (255, np.uint8, [], ""),
        (0.004, np.float32, [], "nearly dark"),
        (60.0, np.float32, [], "full_scale=255"),
        (1.0, np.float32, [], ""),
        (255, np.uint8, ["full_scale=15"], "full_scale=255"),
    ],
)
def test_numbers_that_do_not_fit_the_full_scale(
    warnings: Callable[..., list[str]],
    camera: np.ndarray,
    tmp_path: Path,
    values: float,
    kind: type,
    overrides: list[str],
    told: str,
) -> None:
    imwrite(tmp_path / "snapshot.tiff", (camera / camera.max() * values).astype(kind))
    lines = warnings("measurement=snapshot.tiff", "mask=mask.npy", *overrides)
    assert (not lines and not told) or (len(lines) == 1 and told in lines[0] and "full_scale=" in lines[0]), lines


def test_what_cannot_be_decoded_well(warnings: Callable[..., list[str]], camera: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "saturated.npy", np.full((SIDE, SIDE), 255, np.uint8))
    (line,) = warnings("measurement=saturated.npy", "mask=mask.npy")
    assert "100 % of the pixels are saturated" in line and "full_scale=255" in line
    np.save(tmp_path / "snapshot.npy", camera.astype(np.float32))
    np.save(tmp_path / "ones.npy", np.ones((4, SIDE, SIDE), np.float32))
    assert any(
        "all slots of the mask are equal" in line for line in warnings("measurement=snapshot.npy", "mask=ones.npy")
    )


def test_frames_of_an_earlier_video_are_removed(ran: Callable[..., str], camera: np.ndarray, tmp_path: Path) -> None:
    """Nothing else is: a picture of another name stays."""
    np.save(tmp_path / "two.npy", np.stack([camera, camera]).astype(np.float32))
    np.save(tmp_path / "one.npy", camera.astype(np.float32))
    ran("reconstruct", *QUICK, "measurement=two.npy", "mask=mask.npy")
    (tmp_path / "run" / "frames" / "mine.png").write_bytes(b"")
    ran("reconstruct", *QUICK, "measurement=one.npy", "mask=mask.npy")
    names = sorted(path.name for path in (tmp_path / "run" / "frames").iterdir())
    assert names == ["000_00.png", "000_01.png", "000_02.png", "000_03.png", "mine.png"]


def test_in_tiles(ran: Callable[..., str], camera: np.ndarray, tmp_path: Path) -> None:
    snapshots = np.stack([camera, camera[::-1]]).astype(np.float32)
    np.save(tmp_path / "snapshot.npy", snapshots)
    videos = []
    for tile in ("none", "[40,24]"):
        ran("reconstruct", *QUICK, "measurement=snapshot.npy", "mask=mask.npy", f"tile={tile}", "precision=32")
        videos.append(np.load(tmp_path / "run" / "reconstruction.npy"))
        assert len(list((tmp_path / "run" / "frames").iterdir())) == 8
    assert videos[0].shape == (2, 4, SIDE, SIDE) and videos[0].dtype == np.float32
    np.testing.assert_allclose(videos[0], videos[1], atol=1e-6)


def test_tiles_that_cannot_be(
    refused: Callable[..., str], camera: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sci_lightning.decoder.tiling import tile_choice

    np.save(tmp_path / "snapshot.npy", camera.astype(np.float32))
    given = [*QUICK, "measurement=snapshot.npy", "mask=mask.npy"]
    assert re.search(r"tile=\[2,64\] .*halo of 4", refused("reconstruct", *given, "tile=[2,64]"))
    assert "tile=half: give auto, none" in refused("reconstruct", *given, "tile=half")
    monkeypatch.setattr(tile_choice, "SMALL", 100)
    monkeypatch.setattr(tile_choice, "free_memory", lambda device: 1000)
    line = refused("reconstruct", *given, "tile=none")
    assert "tile=none: GAP needs about" in line and "for 64 x 64 pixels" in line and "give tile=auto" in line
    assert not (tmp_path / "run" / "reconstruction.npy").exists() and not (tmp_path / "run" / "frames").exists()
