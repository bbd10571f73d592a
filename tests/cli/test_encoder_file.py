"""Encoder files: adopted under a name, anchored where they lie, refused with one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hydra.core.config_store import ConfigStore

from sci_lightning.cli.encoder_file import adopt_encoder_files
from sci_lightning.encoder.mask.measured import read_mask
from sci_lightning.errors import BadInput
from tests.encoder_files import TEXT, encoder_file
from tests.training.small_training import TINY

pytestmark = pytest.mark.usefixtures("adopted_encoders")


def test_adopted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    encoder_file(tmp_path / "camera 1")
    encoder_file(tmp_path / "b" / "camera 1")
    (tmp_path / "lsw_sr.yaml").write_text(TEXT)
    monkeypatch.chdir(tmp_path)
    told = [
        "-m",
        "encoder=camera 1/encoder.yaml,b/camera 1/encoder.yaml,rbw_sr",
        "decoder=x.yaml",
        "encoder.aperture=2",
    ]
    arguments = adopt_encoder_files(told)
    assert arguments == ["-m", "encoder='camera_1','camera_1_2',rbw_sr", *told[2:]]
    node = ConfigStore.instance().load("encoder/camera_1_2.yaml").node
    assert node.mask.file == str(tmp_path / "b" / "camera 1" / "patterns.npy")
    assert node.effects.prnu.file == str(tmp_path / "b" / "camera 1" / "prnu.npy")
    assert adopt_encoder_files(["+encoder=lsw_sr.yaml"]) == ["+encoder='lsw_sr_2'"]
    assert adopt_encoder_files(["encoder=lsw_sr"]) == ["encoder=lsw_sr"]
    comma = encoder_file(tmp_path / "lens a, b")
    for value in (comma, f"'{comma}'"):
        assert adopt_encoder_files([f"encoder={value}"]) == ["encoder='lens_a__b'"]
    assert adopt_encoder_files([f"encoder='{comma}',lsw_sr"]) == ["encoder='lens_a__b',lsw_sr"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no such encoder file"),
        ("mask: [1, {", "not a readable YAML"),
        ("- 1\n- 2\n", "not an encoder"),
        ("aperture: 1.0\n", "not an encoder; expected a mapping with _target_"),
        ("", "not an encoder"),
        ("\x00", "not a readable YAML"),
    ],
)
def test_no_encoder(tmp_path: Path, text: str | None, message: str) -> None:
    if text is not None:
        (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(BadInput, match=message) as caught:
        adopt_encoder_files([f"encoder={tmp_path}/mine.yaml"])
    assert "mine.yaml" in str(caught.value)


@pytest.mark.parametrize("target", ["os.system", "pathlib.Path", "sci_lightning.cli.command.run", "sci_lightning.no"])
def test_what_a_file_may_build(tmp_path: Path, refused: Callable[..., str], target: str) -> None:
    path = encoder_file(tmp_path / "camera", text=TEXT.replace("sci_lightning.encoder.effects.MaskShift", target))
    assert f"asks to build '{target}'" in refused("train", f"encoder={path}")
    hidden = TEXT.replace("aperture: 1.0", "aperture: ${oc.create:{_target_:" + target + "}}")
    path = encoder_file(tmp_path / "hidden", text=hidden)
    assert "would be resolved, not read" in refused("train", f"encoder={path}")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("defaults: [/encoder/mask@mask: random_binary]", "the key 'defaults' has no place"),
        ("defaults: [/hydra/output@_global_: out]", "the key 'defaults' has no place"),
        ("hydra: {run: {dir: /tmp}}", "the key 'hydra' has no place"),
        ("encoder@hydra: {a: 1}", "the key 'encoder@hydra' has no place"),
        ("_args_: [1]", "the key '_args_' has no place"),
        ("more: {_partial_: true}", "the key '_partial_' has no place"),
        ("name: ${oc.env:HOME}", "would be resolved, not read"),
        ("frames: ${size}", "would be resolved, not read"),
        ("more: [{size: '${oc.env:HOME}'}]", "would be resolved, not read"),
        ("more: &a [1]\nagain: *a", "aliases"),
        ("wrong: 5", "Encoder has no such setting"),
    ],
)
def test_what_a_file_may_say(tmp_path: Path, refused: Callable[..., str], line: str, message: str) -> None:
    path = encoder_file(tmp_path / "camera", text=f"{TEXT}{line}\n")
    answer = refused("train", f"encoder={path}")
    assert message in answer
    assert str(Path.home()) + "'" not in answer


@pytest.mark.slow
def test_frames_and_size_are_the_files(tmp_path: Path, ran: Callable[..., str]) -> None:
    own = TEXT.replace("${size}", "[24, 24]").replace("${frames}", "8")
    for name, text in (("references", TEXT), ("numbers", own)):
        path = encoder_file(tmp_path / name, size=24, text=text)
        tiny = [override for override in TINY if not override.startswith("size=")]
        ran("train", *tiny, "trainer.max_epochs=1", f"encoder={path}", f"out={name}")
        config = json.loads((tmp_path / name / "metrics.json").read_text())["config"]
        assert (config["frames"], config["size"], config["crop"]) == (8, [24, 24], [24, 24])
        assert config["encoder"]["mask"]["size"] == [24, 24]


def test_files_that_contradict_each_other(tmp_path: Path, refused: Callable[..., str]) -> None:
    one, other = encoder_file(tmp_path / "one", size=24), encoder_file(tmp_path / "other", size=32)
    np.save(tmp_path / "snapshot.npy", np.full((24, 24), 0.4))
    settings = ("decoder=gap_tv", f"encoder={one}", f"decoder.camera={other}", "measurement=snapshot.npy")
    line = refused("reconstruct", *settings)
    assert str(other) in line and str(one) in line and "8 x 32 x 32" in line


def test_frames_and_size_must_agree(tmp_path: Path, refused: Callable[..., str]) -> None:
    path = encoder_file(tmp_path / "camera")
    line = refused("train", f"encoder={path}", "size=[64,64]")
    assert "8 x 32 x 32" in line and "size=[32,32]" in line
    assert "frames=8" in refused("train", f"encoder={path}", "size=[32,32]", "frames=4")
    np.save(path.parent / "patterns.npy", np.zeros((8, 64, 64)))
    assert "map of prnu is (32, 32)" in refused("train", f"encoder={path}", "size=[64,64]")
    assert "no such encoder file" in refused("train", "encoder=nowhere/encoder.yaml")
    assert "no such encoder file" in refused("reconstruct", "encoder=nowhere/encoder.yaml")
    line = refused("train", "effect=[gain,fog]")
    assert "effect=fog: no such effect" in line and "mask_shift" in line


@pytest.mark.parametrize(
    "name", ["/tmp/patterns.npy", "../patterns.npy", "link.npy", "~/patterns.npy", "~nobody/a.npy"]
)
def test_files_outside_of_the_folder_are_not_read(tmp_path: Path, name: str) -> None:
    path = encoder_file(tmp_path / "camera", text=TEXT.replace("patterns.npy", name))
    np.save(tmp_path / "patterns.npy", np.ones((8, 32, 32)))
    (path.parent / "link.npy").symlink_to(tmp_path / "patterns.npy")
    if name == "~nosuchuser/a.npy":  # no such user: a name like any other
        adopt_encoder_files([f"encoder={path}"])
        return
    with pytest.raises(BadInput, match="outside of the encoder file's folder"):
        adopt_encoder_files([f"encoder={path}"])


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ("zz: {" + ",".join(f"{n:x}" for n in range(130_000)) + "}", "more than 100,000 keys"),
        ("zz: 0x" + "f" * 20_000, "whole number of 80000 bits"),
        ("0x" + "f" * 900 + ": 1", "whole number of 3600 bits"),
    ],
)
def test_yaml_that_would_take_hours(tmp_path: Path, more: str, line: str) -> None:
    with pytest.raises(BadInput, match=line):
        adopt_encoder_files([f"encoder={encoder_file(tmp_path, text=TEXT + more)}"])


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        ('{_target_: sci_lightning.encoder.mask.Measured, file: "a\\0b.npy"}', "is no name of a file"),
        ('{_target_: sci_lightning.encoder.mask.Measured, file: "\\ud800.npy"}', "is no name of a file"),
        ("{_target_: sci_lightning.encoder.mask.Mask, frames: 4, size: [16, 16]}", "which is not a module"),
    ],
    ids=["nul", "surrogate", "base class"],
)
def test_masks_that_are_none(refused: Callable[..., str], tmp_path: Path, mask: str, message: str) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(f"_target_: sci_lightning.encoder.Encoder\nmask: {mask}\nsensor: null\n")
    assert message in refused("evaluate", f"encoder={file}", "decoder=gap_tv", "data=synthetic")


def test_a_mask_of_more_slots_than_any(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.ones((5000, 2, 2), np.uint8))
    with pytest.raises(BadInput, match="expected at most 4096 time slots"):
        read_mask(tmp_path / "a.npy")
