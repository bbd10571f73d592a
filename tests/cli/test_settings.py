"""The commands' own settings: each has a type and a range, and a wrong one is refused before anything is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from omegaconf import DictConfig, OmegaConf

from sci_lightning.cli.settings import check_command_settings, settings_of
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.errors import BadInput

COMMANDS = sorted(path.stem for path in CONF.glob("*.yaml"))
GROUPS = {"defaults", "hydra", "benchmark"}
"""Keys at the top of a command's file that are not settings of its own: ``benchmark`` is a data source."""


@pytest.mark.parametrize("command", COMMANDS)
def test_every_setting_has_a_type_and_its_default_is_right(
    command: str, configuration: Callable[..., DictConfig]
) -> None:
    own = OmegaConf.to_container(OmegaConf.load(CONF / f"{command}.yaml"), resolve=False)
    assert isinstance(own, dict)
    assert set(own) - GROUPS <= set(settings_of(command))
    check_command_settings(configuration(command), command)


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("frames", 1, "frames=1: expected a whole number from 2 to 4096"),
        ("frames", "many", "frames=many: expected a whole number"),
        ("size", [256], "size=[256]: expected a list of whole numbers"),
        ("size", [256, -1], "size=[256, -1]"),
        ("size", None, "size=null"),
        ("batch_size", 1.5, "batch_size=1.5: expected a whole number of at least 1|from 1"),
        ("workers", -1, "workers=-1: expected a whole number from 0"),
        ("seed", 1e30, "seed=1e+30: expected a whole number of at least 0"),
        ("seed", True, "seed=true"),
        ("kernels", "fast", "kernels=fast: expected auto, plain"),
        ("resume", 1, "resume=1: expected true or false"),
        ("out", None, "out=null: expected the path of a file or a folder"),
        ("out", "", "out="),
        ("fps", 0, "fps=0: expected a number from 0.1 to 50"),
        ("fps", float("nan"), "fps=nan"),
        ("full_scale", float("inf"), "full_scale=inf"),
        ("trusted", "package", "trusted=package: expected a list"),
        ("sensor", {"full_well": -1}, "sensor="),
    ],
)
def test_wrong_values(key: str, value: Any, line: str) -> None:
    command = next(command for command in ("train", "reconstruct", "tables") if key in settings_of(command))
    with pytest.raises(BadInput) as caught:
        check_command_settings(OmegaConf.create({key: value}), command)
    assert any(part in str(caught.value) for part in line.split("|"))


def test_null_where_the_default_is_null() -> None:
    check_command_settings(OmegaConf.create({"size": None, "mask": None}), "reconstruct")


def test_a_video_that_no_machine_holds() -> None:
    with pytest.raises(BadInput, match=r"frames=4096 size=\[65536,65536\]: .*65536\.0 GiB"):
        check_command_settings(OmegaConf.create({"frames": 4096, "size": [65536, 65536]}), "train")


@pytest.mark.parametrize(
    ("command", "overrides"),
    [
        ("train", ["out=null"]),
        ("train", ["out='${nope}'"]),
        ("train", ["frames=100000"]),
        ("train", ["-m", "out=null", "seed=1,2"]),
        ("reconstruct", ["measurement=x.npy", "fps=0"]),
        ("reconstruct", []),
        ("diagnose", ["captures=x.h5", "search.max_effects=-1"]),
        ("tables", ["runs=3"]),
    ],
)
def test_refused_before_anything_is_written(
    refused: Callable[..., str], tmp_path: Path, command: str, overrides: list[str]
) -> None:
    refused(command, *overrides)
    assert not list(tmp_path.iterdir())
