"""``logger=``: one or several, named after the run; one line for those that are not installed."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from lightning.pytorch.loggers import CSVLogger
from omegaconf import DictConfig

from sci_lightning.cli.composition import plain
from sci_lightning.errors import BadInput
from sci_lightning.training.loggers import RUN_ID, AppendingCSVLogger, build_loggers, run_name, with_run_ids
from tests.conftest import ROOT, members
from tests.training.small_training import TINY

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
    with pytest.raises(BadInput, match=rf"logger={name}: .*sci-lightning\[{name}\]"):
        build_loggers(plain(configuration("train", f"logger={name}", "out=run"))["logger"], "run")


class Server(CSVLogger):
    """Stands in for a logger that keeps its runs on a server, and is not installed here."""

    def __init__(self, id: str | None = None, resume: str | None = None) -> None:
        super().__init__("unused")
        self.id, self.resume = id, resume

    @property
    def experiment(self) -> Any:
        return object()

    @property
    def version(self) -> str:
        return self.id or "new-run"


def test_a_run_on_a_server_is_gone_on_with() -> None:
    settings = {"wandb": {"_target_": f"{__name__}.Server", "id": None}, "csv": None}
    (first,) = build_loggers(settings, "run")
    logged = with_run_ids(settings, [first])
    assert logged["wandb"]["id"] == "new-run"
    for stored, expected in ((logged, ("new-run", "allow")), ({"wandb": {"id": "../x"}}, (None, None))):
        (later,) = build_loggers(settings, "run", stored)
        assert isinstance(later, Server) and (later.id, later.resume) == expected


def test_the_csv_logger_appends(tmp_path: Path) -> None:
    for first in (0, 2):
        logger = AppendingCSVLogger(tmp_path, name="", version="csv")
        logger.log_metrics({"a": float(first)}, first)
        logger.save()
        logger.log_metrics({"b": 1.0}, first + 1)  # a new column
        logger.save()
    path = tmp_path / "csv" / "metrics.csv"
    with path.open(newline="") as file:
        assert [row["step"] for row in csv.DictReader(file)] == ["0", "1", "2", "3"]
    path.write_bytes(path.read_bytes()[:-1])  # a process that was killed while it wrote
    logger = AppendingCSVLogger(tmp_path, name="", version="csv")
    logger.log_metrics({"a": 3.0}, 3)
    logger.save()
    with path.open(newline="") as file:
        assert [(row["step"], row["a"]) for row in csv.DictReader(file)][-2:] == [("2", "2.0"), ("3", "3.0")]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in members("logger") if name != "none"])
def test_a_training_with_each(name: str, tmp_path: Path) -> None:
    """Without a network: W&B writes for a later ``wandb sync``, MLflow into a folder or a data base of the run's."""
    if name in RUN_ID and find_spec(name) is None:
        pytest.skip(f"{name} is not installed: pip install 'sci-lightning[{name}]' -c constraints.txt")
    more = ["logger.wandb.offline=true"] if name == "wandb" else []
    train = [sys.executable, "-m", "sci_lightning.train", *TINY, "metric=[psnr]", f"logger={name}", *more, "out=run"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(train, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and (tmp_path / "run" / "metrics.json").is_file(), done.stderr
    left = [path for path in (tmp_path / "run").rglob(f"{name}*") if path.is_file() or any(path.iterdir())]
    assert left and [path.name for path in tmp_path.iterdir()] == ["run"]
