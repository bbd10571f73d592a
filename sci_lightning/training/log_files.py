"""Logs that a training writes into its folder: a CSV file that is gone on with, and what TensorBoard shows first."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lightning.fabric.loggers.logger import rank_zero_experiment
from lightning.pytorch.loggers import CSVLogger
from lightning.pytorch.loggers import TensorBoardLogger as LightningTensorBoardLogger
from lightning.pytorch.loggers.csv_logs import ExperimentWriter

from sci_lightning.files.atomic_file import atomic_write

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
    """Writes rows below those that are there."""

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
