"""A folder of pictures becomes a captures file."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from scipy.io import savemat
from skimage.io import imsave
from tifffile import imwrite

from sci_lightning.captures import pack_captures, read_captures
from sci_lightning.errors import BadInput
from tests.hostile_files import outside

pytestmark = pytest.mark.filterwarnings("ignore:.*captures.yaml")  # numbers drawn by chance are not plausible

T, H, W = 3, 5, 8
RANDOM = np.random.default_rng(0)
MASKS = RANDOM.integers(0, 256, (T, H, W)).astype(np.uint8)
SHOTS = RANDOM.integers(0, 4096, (11, H, W)).astype(np.uint16)
TARGET = RANDOM.integers(0, 256, (H, W)).astype(np.uint8)
VIDEO = RANDOM.random((T, H, W))


def save(path, values):
    """A picture, a stack or an array by the ending of the name; MATLAB's has time last."""
    if path.suffix == ".mat":
        savemat(path, {"values": np.moveaxis(values, 0, -1) if values.ndim == 3 else values})
    elif path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".tif":
        imwrite(path, values, photometric="minisblack")
    elif path.suffix == ".png":
        imsave(path, values, check_contrast=False)
    else:  # MATLAB 7.3 keeps the axes in reverse
        with h5py.File(path.with_suffix(".mat"), "w") as file:
            file["values"] = values.swapaxes(1, 2)


def recipe(folder, *entries, **top):
    content = {"bit_depth": 12, "patterns": "masks.tif", "captures": list(entries), **top}
    (folder / "captures.yaml").write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}))


@pytest.fixture
def folder(tmp_path):
    """A folder with masks, 11 numbered shots, a target and a video, and a place to pack to."""
    folder = tmp_path / "LAB"
    folder.mkdir()
    save(folder / "masks.tif", MASKS)
    for number, shot in enumerate(SHOTS):
        save(folder / f"shot{number}.tif", shot)
    save(folder / "target.png", TARGET)
    save(folder / "video.npy", VIDEO)
    return folder


def test_everything_a_recipe_can_say(folder, tmp_path):
    recipe(
        folder,
        {"measurement": "shot0.tif", "kind": "dark", "exposure": 2, "sequence": "all_off"},
        {"measurement": "shot*.tif", "scene": 0.5, "aperture": 0.25},
        {"measurement": "shot1.tif", "scene": "target.png", "kind": "static"},
        {"measurement": ["shot2.tif", "shot3.tif"], "scene": "video.npy", "sequence": [2, 1, 0]},
        {"measurement": "shot4.tif", "scene": "unknown", "sequence": 4},
        {"measurement": "shot5.tif", "scene": "0.9", "sequence": [0, "all_off", "all_off"]},
        {"measurement": "shot6.tif", "scene": "target.png", "scene_levels": 510},
        patterns=["masks.tif", "all_off", "all_on"],
        name="lab",
        read_noise_dn=2,
        full_well_e="1e4",
    )
    out = tmp_path / "lab.h5"
    captures = pack_captures(folder, out)
    np.testing.assert_array_equal(captures.measurement, SHOTS[[0, *range(11), 1, 2, 3, 4, 5, 6]])
    np.testing.assert_array_equal(captures.measurement, read_captures(out).measurement)
    np.testing.assert_allclose(captures.patterns, [*(MASKS / 255), np.zeros((H, W)), np.ones((H, W))], rtol=1e-6)
    assert captures.sequence[[0, 1, 13, 15, 16]].tolist() == [[3] * 3, [0, 1, 2], [2, 1, 0], [4] * 3, [0, 3, 3]]
    assert captures.kind == ("dark", *["flat"] * 11, "static", *["dynamic"] * 2, "unknown", "pattern", "static")
    assert captures.aperture.tolist() == [1, *[0.25] * 11, *[1] * 6] and captures.exposure.tolist() == [2, *[1] * 17]
    assert (captures.scene[0] == 0).all() and (captures.scene[1:12] == 0.5).all() and np.isnan(captures.scene[15]).all()
    np.testing.assert_allclose(captures.scene[[12, 17]], [[TARGET / 255] * T, [TARGET / 510] * T], rtol=1e-6)
    np.testing.assert_allclose(captures.scene[14], VIDEO, rtol=1e-6)
    assert (captures.name, captures.read_noise_dn, captures.full_well_e, captures.bit_depth) == ("lab", 2, 1e4, 12)


@pytest.mark.parametrize("ending", [".tif", ".npy", ".mat", ".v73"])
def test_stacks(folder, tmp_path, ending):
    name = ".mat" if ending == ".v73" else ending
    save(folder / f"m{ending}", MASKS)
    save(folder / f"s{ending}", SHOTS)
    recipe(folder, {"measurement": f"s{name}"}, patterns=f"m{name}")
    captures = pack_captures(folder, tmp_path / "a.h5")
    np.testing.assert_array_equal(captures.measurement, SHOTS)
    np.testing.assert_allclose(captures.patterns, MASKS / 255, rtol=1e-6)
    assert captures.name == "LAB" and captures.kind == ("unknown",) * len(SHOTS)


@pytest.mark.parametrize("ending", [".tif", ".png", ".npy", ".mat"])
def test_single_pictures(folder, tmp_path, ending):
    for number in range(T):
        save(folder / f"mask_{number}{ending}", MASKS[number])
    save(folder / f"one{ending}", SHOTS[0])
    recipe(folder, {"measurement": f"one{ending}"}, patterns=f"mask_?{ending}", pattern_levels=510)
    captures = pack_captures(folder, tmp_path / "a.h5")
    np.testing.assert_array_equal(captures.measurement, SHOTS[:1])
    np.testing.assert_allclose(captures.patterns, MASKS / 510, rtol=1e-6)


def test_matlab_doubles_with_whole_numbers_are_raw(folder, tmp_path):
    save(folder / "double.mat", SHOTS.astype(float))
    recipe(folder, {"measurement": "double.mat"})
    np.testing.assert_array_equal(pack_captures(folder, tmp_path / "a.h5").measurement, SHOTS)


def test_a_name_with_brackets_and_natural_order(folder, tmp_path):
    save(folder / "shot[1].tif", SHOTS[7])
    recipe(folder, {"measurement": "shot[1].tif"}, {"measurement": "shot1*.tif"})
    np.testing.assert_array_equal(pack_captures(folder, tmp_path / "a.h5").measurement, SHOTS[[7, 1, 10]])


SHOT = {"measurement": "shot0.tif"}
WRONG = {
    "no measurement": ([{"scene": 1}], {}, "captures[0].measurement: is missing"),
    "unknown key": ([SHOT, {**SHOT, "apperture": 1}], {}, "captures[1].apperture: unknown key; aperture?"),
    "top key": ([SHOT], {"bits": 8}, "bits: unknown key; use bit_depth, name"),
    "no bits": ([SHOT], {"bit_depth": None}, "bit_depth: is missing"),
    "17 bits": ([SHOT], {"bit_depth": 17}, "bit_depth: expected a whole number from 1 to 16, got 17"),
    "half bits": ([SHOT], {"bit_depth": 8.5}, "bit_depth: expected a whole number from 1 to 16, got 8.5"),
    "text": ([SHOT], {"read_noise_dn": "low"}, "read_noise_dn: expected a number of at least 0 or null, got 'low'"),
    "well": ([SHOT], {"full_well_e": 0}, "full_well_e: expected a number above 0 or null, got 0"),
    "name": ([SHOT], {"name": 7}, "name: expected at most 200 printable characters or null, got 7"),
    "no captures": ([], {}, "captures: expected a list of entries, got an empty one"),
    "entry": (["shot0.tif"], {}, "captures[0]: expected keys and values, got 'shot0.tif'"),
    "no file": ([{"measurement": "none*.tif"}], {}, "captures[0].measurement: no file fits 'none*.tif' in"),
    "not a file": (
        [{"measurement": 5}],
        {},
        "captures[0].measurement: expected a file, a glob or a list of them, got 5",
    ),
    "ending": ([{"measurement": "captures.yaml"}], {}, "captures[0].measurement: "),
    "damaged": ([{"measurement": "damaged.tif"}], {}, "damaged.tif: not a readable picture, damaged or truncated"),
    "colour": ([{"measurement": "colour.png"}], {}, "colour.png: one grey channel is expected"),
    "kind": ([{**SHOT, "kind": "still"}], {}, "captures[0].kind: expected dark, flat, pattern, static"),
    "aperture": (
        [{**SHOT, "aperture": -1}],
        {},
        "captures[0].aperture: expected a number of at least 0 or null",
    ),
    "exposure": ([{**SHOT, "exposure": ".inf"}], {}, "captures[0].exposure: expected a number of at least 0 or null"),
    "bits exceeded": (
        [{"measurement": "high.tif"}],
        {},
        "captures[0].measurement: values from 5000 to 5000, expected raw DN, whole numbers from 0 to 4095 (12 bits)",
    ),
    "fractions": ([{"measurement": "video.npy"}], {}, "captures[0].measurement: float64 up to 0.9"),
    "size": (
        [{"measurement": "small.tif"}],
        {},
        "captures[0].measurement: (H, W) is (4, 4), that of the patterns is (5, 8)",
    ),
    "sizes": ([{"measurement": ["shot0.tif", "small.tif"]}], {}, "small.tif is (4, 4) (H, W), the first is (5, 8)"),
    "no slots": ([{**SHOT, "sequence": []}], {}, "captures[0].sequence: has 0 slots, expected 3 as the other captures"),
    "index": ([{**SHOT, "sequence": [0, 1, 3]}], {}, "captures[0].sequence: 3 is no listed pattern, expected 0 to 2"),
    "word": (
        [{**SHOT, "sequence": "all_on"}],
        {},
        "captures[0].sequence: 'all_on' is no listed pattern, expected 0 to 2",
    ),
    "slots": (
        [{**SHOT, "sequence": [0, 1]}, {**SHOT, "sequence": [0]}],
        {},
        "captures[1].sequence: has 1 slots, expected 2 as the other captures",
    ),
    "no sequence": ([SHOT], {"frames": 9}, "captures[0].sequence: is missing: 9 frames, but 3 patterns"),
    "scene": ([{**SHOT, "scene": "none.png"}], {}, "captures[0].scene: no file fits 'none.png'"),
    "scene size": (
        [{**SHOT, "scene": "small.tif"}],
        {},
        "captures[0].scene: is (1, 4, 4), expected (T, H, W) = (3, 5, 8)",
    ),
    "scene frames": ([{**SHOT, "scene": ["shot0.tif", "shot1.tif"]}], {}, "captures[0].scene: is (2, 5, 8), expected"),
    "negative scene": ([{**SHOT, "scene": -1}], {}, "captures[0].scene: expected an irradiance of 0 or more, got -1"),
    "NaN scene": ([{**SHOT, "scene": "nan.npy"}], {}, "captures[0].scene: holds NaN, infinite or negative values"),
    "levels": ([SHOT], {"pattern_levels": 10}, "expected 0 to 1; pattern_levels: what means 1.0"),
    "words": ([SHOT], {"patterns": ["all_off", "masks.tif"]}, "patterns: all_off and all_on come last and once each"),
    "no patterns": ([SHOT], {"patterns": ["all_off"]}, "patterns: no file is named"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_recipe(folder, tmp_path, what):
    entries, top, message = WRONG[what]
    (folder / "damaged.tif").write_bytes((folder / "shot0.tif").read_bytes()[:20])
    save(folder / "colour.png", np.broadcast_to(np.arange(3, dtype=np.uint8), (H, W, 3)).copy())
    save(folder / "high.tif", np.full((H, W), 5000, np.uint16))
    save(folder / "small.tif", np.zeros((4, 4), np.uint16))
    save(folder / "nan.npy", np.full((H, W), np.nan))
    recipe(folder, *entries, **top)
    refused(folder, tmp_path, message, str(folder / "captures.yaml"))


def refused(folder, tmp_path, message, start):
    with pytest.raises(BadInput) as caught:
        pack_captures(folder, tmp_path / "out" / "a.h5")
    assert str(caught.value).startswith(start) and message in str(caught.value) and "\n" not in str(caught.value)
    assert not list(tmp_path.rglob("*.h5"))


def test_no_recipe(tmp_path: Path) -> None:
    refused(tmp_path / "none", tmp_path, "no such folder", str(tmp_path))
    refused(tmp_path, tmp_path, "no captures.yaml in this folder", str(tmp_path))
    for text, message in (
        ("a: [1", "line 1: not a readable YAML file"),
        ("- 1", "expected keys and values (bit_depth, name"),
        ("!!python/object/apply:os.system ['true']", "not a readable YAML file"),
        ("a: &a [1]\nb: *a", "aliases (*name) are not read"),
        ("a: " + "[" * 5000, "not a readable YAML file"),
        ("a" * 2_000_000, "larger than 1,000,000 bytes"),
    ):
        (tmp_path / "captures.yaml").write_text(text)
        refused(tmp_path, tmp_path, message, str(tmp_path / "captures.yaml"))


def test_documented_recipe_is_a_recipe(folder, tmp_path):
    """The example in the module's docstring, word for word, packs a folder that has these files."""
    from sci_lightning.captures import recipe as module

    text = "\n".join(line for line in (module.__doc__ or "").splitlines() if line.startswith("    "))
    (folder / "captures.yaml").write_text(text)
    (folder / "dark").mkdir()
    masks = RANDOM.integers(0, 256, (8, H, W)).astype(np.uint8)
    for name, values in {
        "masks.mat": masks,
        "dark/1.tif": SHOTS[0],
        "dark/2.tif": SHOTS[1],
        "grey.png": SHOTS[2],
    }.items():
        save(folder / name, values)
    save(folder / "still.tif", SHOTS[3])
    captures = pack_captures(folder, tmp_path / "a.h5")
    assert (
        captures.kind == ("dark", "dark", "flat", "static") and captures.frames == 8 and captures.full_well_e == 10500
    )


def test_pages_that_were_appended_one_by_one(folder, tmp_path):
    for mask in MASKS:
        imwrite(folder / "appended.tif", mask, append=True)
    recipe(folder, SHOT, patterns="appended.tif")
    np.testing.assert_allclose(pack_captures(folder, tmp_path / "a.h5").patterns, MASKS / 255, rtol=1e-6)


@pytest.mark.parametrize("key", ["patterns", "measurement", "scene"])
@pytest.mark.parametrize("how", ["external storage", "virtual dataset"])
def test_no_file_of_a_folder_may_name_another(folder, tmp_path, key, how):
    (tmp_path / "secret").write_bytes(bytes(range(H * W)) * T)
    with h5py.File(folder / "theirs.mat", "w") as file:
        outside(file, "values", how, tmp_path / "secret", (T, H, W))
    if key == "patterns":
        recipe(folder, SHOT, patterns="theirs.mat")
    else:
        recipe(folder, {**SHOT, key: "theirs.mat"})
    refused(folder, tmp_path, "theirs.mat: 'values' is kept in another file", str(folder / "captures.yaml"))


@pytest.mark.parametrize(
    "name", ["/tmp/scene.npy", "../scene.npy", "../sc*.npy", "link.npy", "lin*.npy", "a/../../scene.npy"]
)
def test_nothing_outside_of_the_folder_is_read(folder, tmp_path, name):
    np.save(tmp_path / "scene.npy", np.full((4, 6), 0.5))
    (folder / "link.npy").symlink_to(tmp_path / "scene.npy")
    recipe(folder, {"measurement": "shot0.tif", "scene": name})
    with pytest.raises(BadInput, match=r"scene: .* out of "):
        pack_captures(folder, tmp_path / "a.h5")


@pytest.mark.parametrize("name", ["a\0b", "\x1b[2J", "x" * 500])
def test_names_that_nobody_can_write(folder, tmp_path, name):
    recipe(folder, {"measurement": "shot0.tif"}, name=name)
    with pytest.raises(BadInput, match=r"name: .* 200 printable"):
        pack_captures(folder, tmp_path / "a.h5")


def test_more_slots_than_anybody_packs(folder, tmp_path):
    words = ["masks.tif", "all_off"]
    entries = [{"measurement": "shot0.tif", "sequence": "all_off"} for _ in range(100)]
    recipe(folder, *entries, patterns=words, frames=100_000)
    with pytest.raises(BadInput, match=r"100 entries of 100000 slots.* 5,000,000"):
        pack_captures(folder, tmp_path / "a.h5")


def test_a_file_that_is_named_again_and_again(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("sci_lightning.files.memory_bound.memory_bound", lambda: 8 * SHOTS[0].nbytes)
    for entries in ([{"measurement": ["shot0.tif"] * 4}], [{"measurement": "shot0.tif"} for _ in range(4)]):
        recipe(folder, *entries)
        with pytest.raises(BadInput, match="this machine's memory"):
            pack_captures(folder, tmp_path / "a.h5")
