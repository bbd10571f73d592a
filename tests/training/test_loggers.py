"""``logger=``: one or several, named after the run; one line for those that are not installed."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest
from omegaconf import DictConfig

from sci_lightning.cli.composition import plain
from sci_lightning.errors import BadInput
from sci_lightning.training.loggers import RUN_ID, build_loggers, run_name

Configuration = Callable[..., DictConfig]


def test_one_several_or_none(configuration: Configuration, tmp_path: Path) -> None:
    def kinds(*overrides: str) -> list[str]:
        cfg = configuration("train", f"out={tmp_path}", *overrides)
        return [type(logger).__name__ for logger in build_loggers(plain(cfg).get("logger"), "run")]

    assert kinds() == kinds("logger=tensorboard") == ["TensorBoardLogger"]
    assert kinds("logger=csv") == ["AppendingCSVLogger"]
    assert kinds("logger=[tensorboard,csv]") == ["TensorBoardLogger", "AppendingCSVLogger"]
    assert kinds("logger=none") == kinds("logger=[]") == []


def test_the_run_is_named_by_encoder_bits_and_decoder(configuration: Configuration, tmp_path: Path) -> None:
    names = {"names": {"encoder": "lsw_sr", "decoder": "e2e_cnn"}}
    config = plain(configuration("train", "encoder.mask.bits=3")) | names
    assert run_name(config) == "lsw_sr_3bit_e2e_cnn"
    (board,) = build_loggers(plain(configuration("train", f"out={tmp_path}"))["logger"], run_name(config))
    assert board.log_dir == str(tmp_path / "tensorboard" / "lsw_sr_3bit_e2e_cnn")
    (board,) = build_loggers(
        plain(configuration("train", f"out={tmp_path}", "logger.tensorboard.version=mine"))["logger"], "run"
    )
    assert board.log_dir == str(tmp_path / "tensorboard" / "mine")


@pytest.mark.parametrize("name", RUN_ID)
def test_a_logger_that_is_not_installed(name: str, configuration: Configuration) -> None:
    if find_spec(name):
        pytest.skip(f"{name} is installed")
    with pytest.raises(BadInput, match=rf"logger={name}: .* pip install 'sci-lightning\[{name}\]'"):
        build_loggers(plain(configuration("train", f"logger={name}", "out=run"))["logger"], "run")
