"""The comparison of a sweep's runs in the dashboard, by encoder and by bit depth."""

from __future__ import annotations

import lightning as L
from lightning.pytorch.loggers import TensorBoardLogger

from sci_lightning.training.system import System


class ScalarLayout(L.Callback):
    """Groups runs under TensorBoard's "Custom Scalars", whose diagrams select by tag and cannot select by run.

    After every validation ``METRIC/ENCODER_BITSbit`` repeats ``val/METRIC``, and ``loss/ENCODER_BITSbit`` the loss of
    the last step. The layout shows both for the run's encoder, side by side, and the metric for its bit depth.
    TensorBoard joins the layouts of all runs in the order of the runs' names. Therefore every run names all bit depths
    up to its own, so that they appear in order whichever run comes first.

    Args:
        metric: the validation metric, by its name in ``metrics.json``.
    """

    def __init__(self, metric: str = "psnr") -> None:
        self.metric = metric

    def on_fit_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if not isinstance(pl_module, System) or not trainer.is_global_zero:
            return
        encoder, bits = _group(pl_module)
        layout = {  # TensorBoard matches the expressions from the start of a tag
            "encoders": {
                f"{what}, {encoder}": ["Multiline", [f"{what}/{encoder}_[0-9]+bit$"]] for what in (self.metric, "loss")
            },
            "bit depths": {
                f"{self.metric}, {depth} bit{'s' * (depth > 1)}": ["Multiline", [f"{self.metric}/.*_{depth}bit$"]]
                for depth in range(1, bits + 1)
            },
        }
        for board in _boards(trainer):
            board.experiment.add_custom_scalars(layout)

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if trainer.sanity_checking or not isinstance(pl_module, System) or not trainer.is_global_zero:
            return
        encoder, bits = _group(pl_module)
        for what, source in ((self.metric, f"val/{self.metric}"), ("loss", "train/loss")):
            if (value := trainer.callback_metrics.get(source)) is not None:
                for board in _boards(trainer):
                    board.experiment.add_scalar(f"{what}/{encoder}_{bits}bit", value, trainer.global_step)


def _group(system: System) -> tuple[str, int]:
    """Return the name of the run's encoder and its mask's bit depth, by which a sweep names its folders."""
    config = system.run_config
    return config["names"]["encoder"], int(config["encoder"]["mask"].get("bits", 1))


def _boards(trainer: L.Trainer) -> list[TensorBoardLogger]:
    return [logger for logger in trainer.loggers if isinstance(logger, TensorBoardLogger)]
