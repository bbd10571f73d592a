"""Encoder files: adopted under a name, anchored where they lie, refused with one line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hydra.core.config_store import ConfigStore

from sci_lightning.encoder_file import adopt_encoder_files
from sci_lightning.errors import BadInput

TEXT = """
_target_: sci_lightning.encoder.Encoder
aperture: 1.0
mask:
  _target_: sci_lightning.encoder.mask.Measured
  file: patterns.npy
  key: null
  frames: ${frames}
  size: ${size}
sensor: {_target_: sci_lightning.encoder.sensor.ClipQuantise, bit_depth: 8, full_well: null, read_noise: 0.0}
effects:
  mask_shift: {_target_: sci_lightning.encoder.effects.MaskShift, dx: 0.61, dy: -0.35}
  prnu:
    _target_: sci_lightning.encoder.effects.Prnu
    std: 0.02
    file: prnu.npy
    size: ${size}
    seed: 0
  shot_noise: {_target_: sci_lightning.encoder.effects.ShotNoise, full_well: 9000.0}
"""


def encoder_file(folder: Path, size: int = 32, text: str = TEXT) -> Path:
    """An encoder.yaml with what it names beside it."""
    random = np.random.default_rng(0)
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "patterns.npy", random.random((8, size, size)) / 8)
    np.save(folder / "prnu.npy", random.standard_normal((size, size)))
    (folder / "encoder.yaml").write_text(text)
    return folder / "encoder.yaml"


@pytest.fixture(autouse=True)
def _store() -> Iterator[None]:
    """Members adopted in this process are gone after the test."""
    yield
    ConfigStore.instance().repo.pop("encoder", None)


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
    arguments, names = adopt_encoder_files(told)
    assert arguments == ["-m", "encoder='camera_1','camera_1_2',rbw_sr", *told[2:]]
    assert set(names) == {"camera_1", "camera_1_2"}
    assert names["camera_1"].field() == {"frames": 8, "size": [32, 32]}
    node = ConfigStore.instance().load("encoder/camera_1_2.yaml").node
    assert node.mask.file == str(tmp_path / "b" / "camera 1" / "patterns.npy")
    assert node.effects.prnu.file == str(tmp_path / "b" / "camera 1" / "prnu.npy")
    assert adopt_encoder_files(["+encoder=lsw_sr.yaml"], ["lsw_sr"])[0] == ["+encoder='lsw_sr_2'"]
    assert adopt_encoder_files(["encoder=lsw_sr"])[0] == ["encoder=lsw_sr"]


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


@pytest.mark.parametrize("target", ["os.system", "pathlib.Path", "sci_lightning.command.run", "sci_lightning.nothing"])
def test_what_a_file_may_build(tmp_path: Path, refused: Callable[..., str], target: str) -> None:
    path = encoder_file(tmp_path / "camera", text=TEXT.replace("sci_lightning.encoder.effects.MaskShift", target))
    assert f"asks to build '{target}'" in refused("train", f"encoder={path}")
    hidden = TEXT.replace("aperture: 1.0", "aperture: ${oc.create:{_target_:" + target + "}}")
    path = encoder_file(tmp_path / "hidden", text=hidden)
    assert "would be resolved, not read" in refused("train", f"encoder={path}")


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
