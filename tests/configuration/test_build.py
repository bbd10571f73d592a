"""Objects are built from configurations whose names, types and ranges were checked; files may name only our classes."""

from __future__ import annotations

import datetime
import importlib
import inspect
import re
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.configuration.build import build, build_from_file
from sci_lightning.configuration.library_bounds import LIBRARY_BOUNDS
from sci_lightning.configuration.registry import class_for_file, registered_classes
from sci_lightning.decoder import E2ECNN
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import MaskShift
from sci_lightning.errors import BadInput

SMALL = {"_target_": "sci_lightning.decoder.E2ECNN", "frames": 4, "channels": 4, "blocks": 1}
CAMERA: dict[str, Any] = {
    "_target_": "sci_lightning.encoder.Encoder",
    "mask": {"_target_": "sci_lightning.encoder.mask.RandomBinary", "frames": 4, "size": [8, 8]},
    "sensor": {"_target_": "sci_lightning.encoder.sensor.ClipQuantise"},
    "aperture": "auto",
    "effects": {
        "mask_shift": {"_target_": "sci_lightning.encoder.effects.MaskShift", "dx": 1, "dy": 0.5},
        "gain": None,
    },
}


@pytest.mark.parametrize("from_file", [False, True])
def test_nested_objects(from_file: bool, tmp_path: Path) -> None:
    encoder = build_from_file(CAMERA, tmp_path / "a.ckpt", "encoder") if from_file else build(CAMERA, "encoder")
    assert isinstance(encoder, Encoder)
    assert [type(effect) for effect in encoder.path.effects.values()] == [MaskShift]


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ({"channels": "abc"}, "decoder.channels=abc: expected a whole number from 1 to 65536"),
        ({"channels": True}, "decoder.channels=true: expected a whole number"),
        ({"channels": 8.0}, "decoder.channels=8.0: expected a whole number"),
        ({"channels": 0}, "decoder.channels=0: expected a whole number from 1"),
        ({"blocks": -1}, "decoder.blocks=-1: expected a whole number from 1"),
        ({"blocks": None}, "decoder.blocks=null: expected a whole number"),
        ({"input_residual": 1}, "decoder.input_residual=1: expected true or false"),
        ({"chanels": 8}, "decoder.chanels: E2ECNN has no such setting; it has frames, channels"),
        ({"_args_": [8]}, "decoder._args_: not a setting"),
        ({"channels": "a\x1b[31mb\n" * 40}, "a\\x1b[31mb a"),
    ],
)
def test_values_that_do_not_fit(setting: dict[str, Any], line: str) -> None:
    with pytest.raises(BadInput) as caught:
        build({**SMALL, **setting}, "decoder")
    assert line in str(caught.value) and str(caught.value).isprintable() and len(str(caught.value)) < 300


@pytest.mark.parametrize("setting", ["accumulate_grad_batches", "max_epochs", "num_nodes", "gradient_clip_val"])
def test_ranges_of_the_trainer(setting: str) -> None:
    with pytest.raises(BadInput, match=rf"trainer.{setting}=-2: expected a .*number"):
        build({"_target_": "lightning.Trainer", setting: -2}, "trainer")


def test_bounds_of_libraries_name_arguments_that_exist() -> None:
    for path, bounds in LIBRARY_BOUNDS.items():
        module, _, name = path.rpartition(".")
        assert set(bounds) <= set(inspect.signature(getattr(importlib.import_module(module), name)).parameters)


def test_missing_argument() -> None:
    with pytest.raises(BadInput, match=r"decoder.frames: E2ECNN needs it"):
        build({"_target_": SMALL["_target_"]}, "decoder")


def test_what_the_user_names() -> None:
    assert build({"_target_": "datetime.timedelta", "minutes": 2}, "max_time") == datetime.timedelta(minutes=2)
    assert isinstance(build({**SMALL, "_partial_": True}, "decoder")(), E2ECNN)
    for target, line in (
        ("nowhere.Class", "there is no module 'nowhere'"),
        ("torch.nn.Nothing", "no such class"),
        ("torch", "expected the path of a class"),
        (5, "expected the path of a class"),
        ("sci_lightning.configuration.conf_folder.PACKAGE", "not a class or a function"),
    ):
        with pytest.raises(BadInput, match=line):
            build({"_target_": target}, "decoder")
    with pytest.raises(BadInput, match=r"max_time.*: timedelta does not take it"):
        build({"_target_": "datetime.timedelta", "minutes": "two"}, "max_time")


def test_every_registered_class_is_a_class_of_ours() -> None:
    classes = registered_classes()
    assert all(cls.__module__.startswith("sci_lightning.") for cls in classes.values())
    assert classes["sci_lightning.encoder.mask.Measured"] is classes["sci_lightning.encoder.mask.measured.Measured"]


ATTACKS = [
    "os.system",
    "pathlib.Path",
    "shutil.rmtree",
    "torch.load",
    "numpy.load",
    "sympy.sympify",
    "torch.nn.Linear",
    "sci_lightning.runs.checkpoint.Path.touch",
    "sci_lightning.runs.checkpoint.torch.load",
    "sci_lightning.cli.command.run",
    "sci_lightning.decoder.decoder.nn.Identity",
    "sci_lightning.encoder.mask.measured.read_mask",
    "sci_lightning.training.system.System",
    "sci_lightning.decoder.E2ECNN.__init__.__globals__",
    "sci_lightning.data.Folder",
    "..os.system",
    "",
    None,
    3,
    ["os.system"],
    "os\n.system",
]


@pytest.mark.parametrize("target", ATTACKS, ids=repr)
def test_what_a_file_may_not_name(target: Any, tmp_path: Path) -> None:
    for config in ({"_target_": target}, {**CAMERA, "sensor": {"_target_": target, "command": "touch x"}}):
        with pytest.raises(BadInput, match="is not a module of sci_lightning") as caught:
            build_from_file(config, tmp_path / "a.ckpt", "encoder")
        assert str(caught.value).isprintable()


@pytest.mark.parametrize("key", ["_partial_", "_args_", "_convert_", "_recursive_"])
def test_instructions_in_a_file(key: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=f"{key}: not a setting"):
        build_from_file({**SMALL, key: True}, tmp_path / "a.ckpt", "decoder")


def test_trusted_packages_open_themselves_and_nothing_they_import(tmp_path: Path) -> None:
    path = tmp_path / "a.ckpt"
    mine = "tests.configuration.test_build.Mine"
    with pytest.raises(BadInput, match=r"trusted=\[tests\]"):
        class_for_file(path, mine)
    assert class_for_file(path, mine, ["tests"]).__name__ == "Mine"
    for name in ("Path", "E2ECNN", "build", "pytest.main", "Nothing", "datetime.timedelta"):
        with pytest.raises(BadInput, match=rf"{re.escape(name)}.*(nn\.Module|cannot be imported)"):
            class_for_file(path, f"tests.configuration.test_build.{name}", ["tests"])


class Mine(E2ECNN):
    """A decoder that is not part of the package."""
