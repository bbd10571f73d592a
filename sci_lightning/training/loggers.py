"""Where a training is logged: ``logger=tensorboard``, ``'logger=[tensorboard,csv]'``, and the log in its folder."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lightning.fabric.loggers.logger import rank_zero_experiment
from lightning.pytorch.loggers import CSVLogger, Logger
from lightning.pytorch.loggers import TensorBoardLogger as LightningTensorBoardLogger
from lightning.pytorch.loggers.csv_logs import ExperimentWriter

from sci_lightning.configuration.build import build
from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.plain_text import with_article

RUN_NAME = {"tensorboard": "version", "wandb": "name", "mlflow": "run_name"}
"""What the loggers call a run's name."""

RUN_ID = {"wandb": "id", "mlflow": "run_id"}
"""What those that keep runs on a server call the one that they write to. Each needs a package of its own name, which is
an optional extra of ours."""

ID = re.compile(r"[\w-]{1,100}", re.ASCII)


def build_loggers(
    settings: Mapping[str, Any] | None, run_name: str, earlier: Mapping[str, Any] | None = None
) -> list[Logger]:
    """Build the loggers that a command's configuration names under ``logger``; an entry that is None is left out.

    Args:
        settings: the plain configuration of each logger by its name; None for no loggers.
        run_name: of the run on the dashboard, for those that are not given one.
        earlier: ``logger`` in the checkpoint of a training that goes on, which may be a stranger's: of it nothing but
            the run on a server is taken, to which is appended.

    Raises:
        BadInput: a logger whose package is not installed, or something that is no logger.
    """
    return [_built(name, logger, run_name, earlier or {}) for name, logger in (settings or {}).items() if logger]


def with_run_ids(settings: Mapping[str, Any] | None, loggers: Sequence[Logger]) -> dict[str, Any]:
    """Return the settings of loggers with the runs on servers that they write to, which this begins."""
    known = {name: dict(logger) for name, logger in (settings or {}).items() if logger}
    for (name, logger), built in zip(known.items(), loggers, strict=True):
        if name in RUN_ID and built.experiment and built.version:  # type: ignore[attr-defined]  # not of every logger
            logger[RUN_ID[name]] = str(built.version)
    return known


def run_name(config: Mapping[str, Any]) -> str:
    """Return what a run is called on a dashboard: encoder, bit depth of its mask, decoder.

    Args:
        config: plain configuration of the run, with ``names``.
    """
    names = config["names"]
    return f"{names['encoder']}_{config['encoder']['mask'].get('bits', 1)}bit_{names['decoder']}"


def _built(name: str, settings: Mapping[str, Any], run_name: str, earlier: Mapping[str, Any]) -> Logger:
    key = RUN_NAME.get(name, "")
    named = {key: run_name} if key in settings and settings[key] is None else {}
    key = RUN_ID.get(name, "")
    before = (earlier.get(name) or {}).get(key)
    if settings.get(key) is None and isinstance(before, str) and ID.fullmatch(before):
        named |= {key: before} | ({"resume": "allow"} if name == "wandb" else {})
    try:
        logger = build(settings, f"logger.{name}", **named)
    except BadInput as error:
        if name not in RUN_ID or not isinstance(error.__cause__, ImportError):
            raise
        raise BadInput(
            f"logger={name}: {name} is not installed; pip install 'sci-lightning[{name}]', or logger=tensorboard"
        ) from error
    if not isinstance(logger, Logger):
        raise BadInput(f"logger.{name}: its _target_ is {with_article(type(logger).__name__)}, not a Logger")
    return logger


CURVES = {"train/loss": "curves/loss", "val/psnr": "curves/psnr"}
"""What is shown first, and under which tag: TensorBoard sorts groups by name and opens the first two, which are
``curves`` and ``mask``. The tags name no encoder and no bit depth, so that the runs of a sweep share a chart."""


class AppendingCSVLogger(CSVLogger):
    """Appends to ``metrics.csv``; Lightning's own deletes a file that is there.

    Steps that a killed run has logged after its last checkpoint are computed again, with the same numbers, and stand in
    the file twice.
    """

    @property
    @rank_zero_experiment
    def experiment(self) -> Any:
        """The writer of the file, which is not made before something is logged."""
        if self._experiment is None:
            self._experiment = _Writer(self.log_dir)
        return self._experiment


class _Writer(ExperimentWriter):
    """Writes rows below those that are there; Lightning has no public way to keep its own from deleting them."""

    def _check_log_dir_exists(self) -> None:
        """Take the columns from the file; a row that a killed process has half-written is left out of it."""
        path = Path(self.metrics_file_path)
        if not path.is_file():
            return
        with path.open("rb+") as file:
            content = file.read()
            file.truncate(content.rfind(b"\n") + 1)
        with path.open(newline="") as file:
            self.metrics_keys = next(csv.reader(file), [])
        if not self.metrics_keys:
            path.unlink()

    def _rewrite_with_new_header(self, fieldnames: list[str]) -> None:
        with open(self.metrics_file_path, newline="") as file:
            rows = list(csv.DictReader(file))
        with atomic_write(self.metrics_file_path) as temporary, temporary.open("w", newline="") as file:
            writer = csv.DictWriter(file, fieldnames)
            writer.writeheader()
            writer.writerows(rows)


class TensorBoardLogger(LightningTensorBoardLogger):
    """Lightning's logger, with loss and PSNR repeated in a group of charts that TensorBoard shows first.

    The number of the epoch, which Lightning adds to everything that is logged, is left out.
    """

    def log_metrics(self, metrics: Mapping[str, Any], step: int | None = None) -> None:
        values = {tag: value for tag, value in metrics.items() if tag != "epoch"}
        super().log_metrics(values | {CURVES[tag]: value for tag, value in values.items() if tag in CURVES}, step)
