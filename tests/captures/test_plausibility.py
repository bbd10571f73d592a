"""The likeliest mistakes of a laboratory are found while its folder is packed, and a right folder passes in silence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from sci_lightning.captures import pack_captures, read_captures
from sci_lightning.captures.plausibility import Entry, check_entries, suspicions
from sci_lightning.captures.recipe import CaptureEntry, Top
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import EFFECTS, Session, VirtualCamera

T, H, W, FULL = 4, 24, 32, 4095
RANDOM = np.random.default_rng(0)
PATTERNS = RANDOM.integers(0, 2, (T, H, W))
TARGET = RANDOM.integers(20, 256, (H, W)).astype(np.uint8)


def record(level: Any, patterns: np.ndarray = PATTERNS, aperture: float = 0.5) -> np.ndarray:
    """An ideal 12-bit camera with a dark level of 30 DN and noise."""
    light = aperture * (patterns * level).sum(0)
    return np.clip(light * FULL + 30 + RANDOM.normal(0, 3, (H, W)), 0, FULL).astype(np.uint16)


def laboratory(folder: Path) -> dict[str, Any]:
    """A folder of right files; its recipe, to be changed."""
    folder.mkdir()
    one = np.zeros((T, 1, 1))
    one[1] = 1
    files = {
        "masks": 3 * PATTERNS.astype(np.uint8),  # levels 0 to 3
        "dark": np.stack([record(0.0) for _ in range(2)]),
        "grey": np.stack([record(0.4) for _ in range(2)]),
        "single": record(0.6, PATTERNS * one),
        "still": record(TARGET / 255),
        "unknown": record(0.7),
        "target": TARGET,
        "target_dn": TARGET.astype(float),
    }
    for name, values in files.items():
        np.save(folder / f"{name}.npy", values)
    return {
        "bit_depth": 12,
        "patterns": ["masks.npy", "all_off"],
        "pattern_levels": 3,
        "captures": [
            {"measurement": "dark.npy", "kind": "dark", "sequence": "all_off", "exposure": 4},
            {"measurement": "grey.npy", "scene": 0.4, "aperture": 0.5},
            {
                "measurement": "single.npy",
                "scene": 0.6,
                "aperture": 0.5,
                "sequence": ["all_off", 1, "all_off", "all_off"],
            },
            {"measurement": "still.npy", "scene": "target.npy", "aperture": 0.5},
            {"measurement": "unknown.npy", "aperture": 0.5},
        ],
    }


def packed(folder: Path, content: dict[str, Any]) -> list[str]:
    """Pack a folder; the warnings."""
    lines: list[str] = []
    (folder / "captures.yaml").write_text(yaml.safe_dump(content))
    pack_captures(folder, folder.with_suffix(".h5"), on_warning=lines.append)
    assert all(line.startswith(f"{folder}/captures.yaml: ") and "\n" not in line for line in lines)
    return lines


def test_a_right_folder(tmp_path: Path) -> None:
    assert packed(tmp_path / "LAB", laboratory(tmp_path / "LAB")) == []


def change(content: dict[str, Any], entry: int | None, **values: Any) -> dict[str, Any]:
    place = content if entry is None else content["captures"][entry]
    place.update(values)
    return content


@pytest.mark.parametrize(
    ("entry", "values", "message"),
    [
        (1, {"scene": 40}, "captures[1].scene: 40 predicts 4"),
        (
            1,
            {"scene": 1638},
            "1.0 is the irradiance that fills the sensor's range (1638 % is 16.38, and 1638 DN are 0.4)",
        ),
        (3, {"scene": "target_dn.npy"}, "captures[3].scene: 25"),
        (1, {"exposure": 0}, "captures[1].exposure: 0 collects no light, but the capture is flat; 1 is the nominal"),
        (1, {"exposure": -1}, "captures[1].exposure: expected a number of at least 0 or null"),
        (1, {"exposure": 1e9}, "captures[1].exposure: 1e+09 is no factor relative to nominal"),
        (1, {"aperture": 0, "kind": "flat"}, "captures[1].aperture: 0 lets no light in, but kind is flat"),
        (1, {"aperture": 1e9}, "captures[1].aperture: 1e+09 is no factor relative to nominal"),
        (None, {"pattern_levels": 255}, "times the light that this predicts was measured; is it pattern_levels: 3?"),
        (None, {"bit_depth": 10}, "expected raw DN, whole numbers from 0 to 1023 (10 bits)"),
        (
            1,
            {"measurement": "turned.npy"},
            "(H, W) is (32, 24), that of the patterns is (24, 32); are H and W swapped?",
        ),
        (
            3,
            {"scene": "turned.npy"},
            "captures[3].scene: is (1, 32, 24), expected (T, H, W) = (4, 24, 32) or (H, W); are",
        ),
        (
            1,
            {"measurement": "shifted.npy"},
            "expected raw DN, whole numbers from 0 to 4095 (12 bits); all are multiples of 16",
        ),
    ],
)
def test_what_cannot_be_right_is_refused(
    tmp_path: Path, entry: int | None, values: dict[str, Any], message: str
) -> None:
    content = change(laboratory(tmp_path / "LAB"), entry, **values)
    np.save(tmp_path / "LAB" / "turned.npy", np.load(tmp_path / "LAB" / "grey.npy")[0].T)
    np.save(tmp_path / "LAB" / "shifted.npy", np.load(tmp_path / "LAB" / "grey.npy") * 16)
    with pytest.raises(BadInput) as caught:
        packed(tmp_path / "LAB", content)
    line = str(caught.value)
    assert message in line and line.startswith(f"{tmp_path}/LAB/captures.yaml: ") and "\n" not in line
    assert not (tmp_path / "LAB.h5").exists()


@pytest.mark.parametrize(
    ("entry", "values", "message"),
    [
        (1, {"aperture": 10}, "captures[1]: scene, patterns and aperture predict 8"),
        (1, {"aperture": 0.02}, "captures[1]: scene, patterns and aperture predict 0.01"),
        (
            4,
            {"scene": 3, "measurement": "white.npy"},
            "captures[4]: a scene of 3 is that many times what fills the sensor",
        ),
        (4, {"exposure": 500}, "captures[4]: exposure 500 is relative to the nominal integration time; is it in ms?"),
        (4, {"aperture": 1800}, "captures[4]: aperture 1800 is a light scale"),
        (0, {"measurement": "bright.npy"}, "captures: dark ones reach 39"),
        (None, {"bit_depth": 16}, "bit_depth: 16 bits reach 65535, no capture exceeds"),
        (None, {"read_noise_dn": 0.1}, "read_noise_dn: 0.1 DN are stated, repeated dark captures differ by"),
        (None, {"read_noise_dn": 2000}, "read_noise_dn: 2000 DN, and full scale is 4095"),
        (None, {"full_well_e": 10}, "full_well_e: 10 electrons at full scale, cameras have 100 to 1e+07"),
        (None, {"patterns": ["inverted.npy", "all_off"]}, "are the patterns inverted?"),
    ],
)
def test_what_is_unlikely_is_one_line(tmp_path: Path, entry: int | None, values: dict[str, Any], message: str) -> None:
    content = change(laboratory(tmp_path / "LAB"), entry, **values)
    np.save(tmp_path / "LAB" / "inverted.npy", 3 - np.load(tmp_path / "LAB" / "masks.npy"))
    np.save(tmp_path / "LAB" / "bright.npy", record(1.0, aperture=1.0))
    np.save(tmp_path / "LAB" / "white.npy", np.full((H, W), FULL, np.uint16))
    lines = packed(tmp_path / "LAB", content)
    assert any(message in line for line in lines), lines
    assert len(lines) <= 2, lines
    assert len(read_captures(tmp_path / "LAB.h5")) > 0


def test_every_exposure_the_same(tmp_path: Path) -> None:
    content = laboratory(tmp_path / "LAB")
    for entry in content["captures"]:
        entry["exposure"] = 20
    (line,) = packed(tmp_path / "LAB", content)
    assert re.search(r"captures\[1\], captures\[2\], captures\[3\] and 1 more: .*exposure 20", line)


def test_a_datasheet_that_is_wrong_by_a_factor_of_two(tmp_path: Path) -> None:
    content = laboratory(tmp_path / "LAB")
    assert packed(tmp_path / "LAB", {**content, "read_noise_dn": 1.5, "full_well_e": 9000}) == []  # a diagnosis sees it


def test_files_that_are_one_and_the_same(tmp_path: Path) -> None:
    content = laboratory(tmp_path / "LAB")
    content["captures"] = [{"measurement": "unknown.npy"}, {"measurement": "unknown.npy"}]
    (line,) = packed(tmp_path / "LAB", content)
    assert "captures: all 2 are identical in every pixel" in line


def test_dim_patterns_without_known_scenes(tmp_path: Path) -> None:
    content = laboratory(tmp_path / "LAB")
    content["captures"] = [content["captures"][4]]
    content["pattern_levels"] = 255
    (line,) = packed(tmp_path / "LAB", content)
    assert "pattern_levels: the largest value is 3, 0.012 of 255" in line
    del content["pattern_levels"]  # the largest value of an integer type
    (line,) = packed(tmp_path / "LAB", content)
    assert "is it pattern_levels: 3?" in line


def test_numbers_that_were_shifted(tmp_path: Path) -> None:
    content = laboratory(tmp_path / "LAB")
    for name in ("dark", "grey", "single", "still", "unknown"):
        np.save(tmp_path / "LAB" / f"{name}.npy", np.load(tmp_path / "LAB" / f"{name}.npy") * 16)
    content["bit_depth"] = 16
    (line,) = packed(tmp_path / "LAB", content)
    assert "captures: every DN is a multiple of 16" in line


@pytest.mark.parametrize("effect", ["none", *EFFECTS])
def test_a_camera_that_is_not_ideal_is_plausible(effect: str) -> None:
    """No effect that the program knows how to name is taken for a mistake of the recipe."""
    session = Session(size=(24, 32), frames=4, bit_depth=12, mask="binary", unknown=1)
    try:
        captures = VirtualCamera(session, effect).capture(1)
    except BadInput:
        pytest.skip("cannot be hidden in this session")
    entries = [
        Entry(
            CaptureEntry(measurement=["a.tif"]),
            captures.measurement[index : index + 1],
            captures.sequence[index],
            captures.scene[index],
            float(captures.aperture[index]),
            float(captures.exposure[index]),
            captures.kind[index],
        )
        for index in range(len(captures))
    ]
    check_entries(entries)
    assert suspicions(Top(bit_depth=12, patterns=["a.tif"], captures=[]), entries, captures.patterns, 4, 12) == []


def test_an_aperture_that_was_forgotten(tmp_path: Path) -> None:
    """All captures are half as bright as their recipe says: no gain is so wrong."""
    content = laboratory(tmp_path / "LAB")
    for entry in content["captures"]:
        entry.pop("aperture", None)
    (line,) = packed(tmp_path / "LAB", content)
    assert "times the light that was measured (median of 3); is it aperture: 0.5 times what is stated?" in line
