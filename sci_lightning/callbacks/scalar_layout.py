"""The dashboard's comparison of a sweep's rows: by encoder and by bit depth."""

from __future__ import annotations

import lightning as L
from lightning.pytorch.loggers import TensorBoardLogger

from sci_lightning.system import System


class ScalarLayout(L.Callback):
    """Groups runs under TensorBoard's "Custom Scalars", whose charts choose by tag and never by run.

    After every validation ``METRIC/ENCODER_BITSbit`` repeats ``val/METRIC``; the layout has a chart for the run's
    encoder and one for its bit depth. TensorBoard merges the layouts of all runs below its log folder.

    Args:
        metric: of validation, by its name in ``metrics.json``.
    """

    def __init__(self, metric: str = "psnr") -> None:
        self.metric = metric

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if not isinstance(pl_module, System) or not trainer.is_global_zero:
            return
        encoder, bits = _group(pl_module)
        charts = {  # of tags that match an expression from the first letter on
            "encoders": {f"{self.metric}, {encoder}": ["Multiline", [f"{self.metric}/{encoder}_.*"]]},
            "bit depths": {f"{self.metric}, {bits}": ["Multiline", [f"{self.metric}/.*_{bits}$"]]},
        }
        for board in _boards(trainer):
            board.experiment.add_custom_scalars(charts)

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        value = trainer.callback_metrics.get(f"val/{self.metric}")
        if value is None or trainer.sanity_checking or not isinstance(pl_module, System) or not trainer.is_global_zero:
            return
        for board in _boards(trainer):
            board.experiment.add_scalar(f"{self.metric}/{'_'.join(_group(pl_module))}", value, trainer.global_step)


def _group(system: System) -> tuple[str, str]:
    """The run's encoder by name and its mask's bit depth, as a sweep names its folders."""
    config = system.run_config
    return config["names"]["encoder"], f"{config['encoder']['mask'].get('bits', 1)}bit"


def _boards(trainer: L.Trainer) -> list[TensorBoardLogger]:
    return [logger for logger in trainer.loggers if isinstance(logger, TensorBoardLogger)]
