"""Masks as files of a modulator, and back bit for bit."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch
from omegaconf import DictConfig
from PIL import Image

from sci_lightning.cli.composition import plain
from sci_lightning.encoder.mask import LearnedStructural, RandomBinary
from sci_lightning.errors import BadInput
from sci_lightning.files import modulator_files
from sci_lightning.files.modulator_files import Layout, display_times, levels_of, read_planes, timing_of, write_planes
from sci_lightning.runs.checkpoint import write_weights
from tests.files.formats import check

TIMING = timing_of(2, 1, 1.0, 1e4, 1e4)


@pytest.mark.parametrize("bits", range(1, 9))
def test_there_and_back(bits: int, tmp_path: Path) -> None:
    mask = LearnedStructural(bits, 5, (12, 10), seed=bits)().detach()
    write_planes(mask, bits, tmp_path, Layout((12, 10), 2, (30, 41)), timing_of(5, bits, 10, 1e4, 200))
    assert torch.equal(read_planes(tmp_path), mask)
    sheet = json.loads((tmp_path / "planes.json").read_text())
    check("mask_planes", sheet)
    assert len(sheet["planes"]) == 5 * bits
    assert [each["bit"] for each in sheet["planes"][:bits]] == list(reversed(range(bits)))
    shown = np.zeros((5, 30, 41))
    for plane in sheet["planes"]:  # what the mirrors do in a slot is the mask, 2 x 2, in the middle
        with Image.open(tmp_path / plane["file"]) as picture:
            assert picture.mode == "1"
            shown[plane["slot"]] += plane["exposure"] * np.asarray(picture)
    np.testing.assert_allclose(shown[:, 3:27, 10:30], mask.numpy().repeat(2, 1).repeat(2, 2), atol=1e-12)
    assert shown.sum() == pytest.approx(4 * float(mask.sum()))
    with Image.open(tmp_path / "frames" / "slot01.png") as picture:
        assert picture.mode == "L" and picture.size == (41, 30)
        assert np.asarray(picture)[3, 10] == round(255 * float(mask[0, 0, 0]))


@pytest.mark.parametrize(("order", "bits"), [("msb_first", [3, 2, 1, 0]), ("lsb_first", [0, 1, 2, 3])])
def test_planes_fill_the_slot_in_their_order(order: Literal["msb_first", "lsb_first"], bits: list[int]) -> None:
    times = display_times(4, order)
    assert [bit for bit, _, _ in times] == bits
    assert [end - begin for _, begin, end in times] == pytest.approx([2**bit / 15 for bit in bits])
    assert [begin for _, begin, _ in times] == pytest.approx([0, *(end for _, _, end in times[:-1])])
    assert times[-1][2] == 1


def test_the_least_significant_plane_may_come_first(tmp_path: Path) -> None:
    mask = LearnedStructural(2, 3, (8, 8), seed=1)().detach()
    write_planes(mask, 2, tmp_path, Layout((8, 8), 1, (8, 8)), timing_of(3, 2, 10, 1e4, 200), "lsb_first")
    sheet = json.loads((tmp_path / "planes.json").read_text())
    check("mask_planes", sheet)
    assert sheet["order"] == "lsb_first" and [plane["bit"] for plane in sheet["planes"]] == [0, 1] * 3
    assert torch.equal(read_planes(tmp_path), mask)


def test_binary_mask(tmp_path: Path) -> None:
    mask = RandomBinary(4, (8, 8), seed=3)()
    write_planes(mask, 1, tmp_path, Layout((8, 8), 1, (8, 8)), TIMING)
    assert torch.equal(read_planes(tmp_path), mask)


def test_a_second_export_leaves_nothing_of_the_first(tmp_path: Path) -> None:
    for frames, bits in ((4, 3), (3, 2)):
        mask = LearnedStructural(bits, frames, (8, 8), seed=1)().detach()
        write_planes(mask, bits, tmp_path, Layout((8, 8), 1, (8, 8)), TIMING)
    assert len(list(tmp_path.glob("planes/*.png"))) == 6 and len(list(tmp_path.glob("frames/*.png"))) == 3


def test_an_interrupted_export_leaves_no_sheet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An earlier sheet would vouch for pictures of two masks."""
    layout = Layout((8, 8), 1, (8, 8))
    write_planes(RandomBinary(4, (8, 8), seed=3)(), 1, tmp_path, layout, TIMING)
    written: list[Path] = []

    def interrupted(path: Path, picture: object) -> None:
        if len(written) == 3:
            raise KeyboardInterrupt
        written.append(path)

    monkeypatch.setattr(modulator_files, "_write_png", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_planes(RandomBinary(4, (8, 8), seed=4)(), 1, tmp_path, layout, TIMING)
    with pytest.raises(BadInput, match="not the planes of a mask"):
        read_planes(tmp_path)


def test_timing() -> None:
    timing = timing_of(8, 4, frame_rate=50, binary_rate=32552, gray_rate=4069)
    assert timing.slot_s == pytest.approx(1 / 400)
    assert timing.shortest_plane_s == pytest.approx(1 / 6000)
    assert timing.fastest_by_planes_Hz == pytest.approx(32552 / 120)
    assert timing.fastest_by_gray_frames_Hz == pytest.approx(4069 / 8)
    assert timing.planes_fit and timing.gray_frames_fit
    assert not timing_of(8, 4, frame_rate=300, binary_rate=32552, gray_rate=4069).planes_fit
    with pytest.raises(BadInput, match="must be positive"):
        timing_of(8, 4, frame_rate=0, binary_rate=1, gray_rate=1)
    phased = timing_of(8, 4, frame_rate=50, binary_rate=32552, gray_rate=4069, reset_time=25e-6)
    assert phased.phased_reset_slots == pytest.approx(0.01)
    with pytest.raises(BadInput, match=r"a slot lasts 0\.0025 s; reset within a slot"):
        timing_of(8, 4, frame_rate=50, binary_rate=32552, gray_rate=4069, reset_time=0.003)


def test_what_cannot_be_shown(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no levels of 2 bits"):
        levels_of(torch.full((2, 4, 4), 0.3), 2)
    with pytest.raises(BadInput, match="larger canvas"):
        Layout((256, 256), 4, (768, 1024))
    with pytest.raises(BadInput, match="not the planes of a mask"):
        read_planes(tmp_path)


def test_damaged_planes(tmp_path: Path) -> None:
    write_planes(RandomBinary(2, (8, 8))(), 1, tmp_path, Layout((8, 8), 1, (8, 8)), TIMING)
    plane = tmp_path / "planes" / "slot01_bit0.png"
    Image.new("1", (4, 4)).save(plane)
    with pytest.raises(BadInput, match="expected 1-bit"):
        read_planes(tmp_path)
    plane.unlink()
    with pytest.raises(BadInput, match="not the planes"):
        read_planes(tmp_path)


def test_the_command(configuration: Callable[..., DictConfig], ran: Callable[..., str], tmp_path: Path) -> None:
    mask = LearnedStructural(3, 8, (16, 24), seed=1)
    names = {"encoder": "lsw_sr", "decoder": "res2former"}
    config = {**plain(configuration("train", "encoder.mask.bits=3", "size=[16,24]")), "names": names}
    write_weights(tmp_path / "a.ckpt", config, {"encoder.mask.weight": mask.weight.detach()})
    printed = ran(
        "export_mask",
        "ckpt_path=a.ckpt",
        "repeat=2",
        "canvas=[768,1024]",
        "out=out",
        "frame_rate=600",
        "reset_time=2e-5",
    )
    assert "8 slots of 3 bit" in printed and "too fast" in printed
    assert "bit_planes.order=msb_first, phased_reset.delay=0.096" in printed
    assert torch.equal(read_planes(tmp_path / "out"), mask().detach())
    assert len(list((tmp_path / "out" / "planes").glob("*.png"))) == 24


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("frames", 10**9),
        ("frames", "4"),
        ("size", [float("inf"), 1]),
        ("canvas", [10**9, 10**9]),
        ("full_level", 0),
        ("planes", [{"file": "../outside.png", "slot": 0, "bit": 0, "exposure": 1.0}]),
        ("planes", [{"file": "link.png", "slot": 0, "bit": 0, "exposure": 1.0}]),
        ("planes", [{"file": "page.png", "slot": 0, "bit": 0, "exposure": 1.0}]),
        ("planes", [{"file": "planes/slot01_bit0.png", "slot": 0, "bit": 10**30, "exposure": 1.0}]),
        ("planes", [{"file": "planes/slot01_bit0.png", "slot": -1, "bit": 0, "exposure": 1.0}]),
        ("planes", [{"file": "planes/slot01_bit0.png", "slot": 0, "bit": 0, "exposure": 1.0}] * 1000),
    ],
)
def test_planes_of_a_stranger(tmp_path: Path, key: str, value: object) -> None:
    """Nothing outside of the folder is read, and nothing but PNG: Pillow would hand PostScript to an interpreter."""
    folder = tmp_path / "planes of somebody"
    layout = Layout((4, 4), 1, (4, 4))
    write_planes(torch.ones(2, 4, 4), 1, folder, layout, TIMING)
    picture = (folder / "planes/slot01_bit0.png").read_bytes()
    (tmp_path / "outside.png").write_bytes(picture)
    (folder / "link.png").symlink_to(tmp_path / "outside.png")
    page = '%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 4 4\n%%EndComments\n%ImageData: 4 4 1 1 0 1 1 "x"\n%%EOF\n'
    (folder / "page.png").write_text(page)
    about = json.loads((folder / "planes.json").read_text())
    (folder / "planes.json").write_text(json.dumps({**about, key: value}))
    with pytest.raises(BadInput, match="not the planes of a mask"):
        read_planes(folder)


def test_a_sheet_that_is_nested_without_end(tmp_path: Path) -> None:
    (tmp_path / "planes.json").write_text("[" * 100_000)
    with pytest.raises(BadInput, match="not the planes of a mask"):
        read_planes(tmp_path)
