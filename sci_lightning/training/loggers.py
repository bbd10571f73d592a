"""Where a training is logged: ``logger=tensorboard``, ``'logger=[tensorboard,csv]'``, ..."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sci_lightning.configuration.build import build
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import with_article

if TYPE_CHECKING:  # a command without a logger starts without Lightning, which takes seconds to import
    from lightning.pytorch.loggers import Logger

RUN_NAME = {"tensorboard": "version", "wandb": "name", "mlflow": "run_name"}
"""What the loggers call a run's name."""

EXTRAS = ("wandb", "mlflow")
"""Loggers that need a package of the same name, which is an optional extra of ours."""


def build_loggers(settings: Mapping[str, Any] | None, run_name: str) -> list[Logger]:
    """Build the loggers that a command's configuration names under ``logger``; an entry that is None is left out.

    Args:
        settings: the plain configuration of each logger by its name; None for no loggers.
        run_name: of the run on the dashboard, for those that are not given one.

    Raises:
        BadInput: a logger whose package is not installed, or something that is no logger.
    """
    return [_built(name, logger, run_name) for name, logger in (settings or {}).items() if logger]


def run_name(config: Mapping[str, Any]) -> str:
    """Return what a run is called on a dashboard: encoder, bit depth of its mask, decoder.

    Args:
        config: plain configuration of the run, with ``names``.
    """
    names = config["names"]
    return f"{names['encoder']}_{config['encoder']['mask'].get('bits', 1)}bit_{names['decoder']}"


def _built(name: str, settings: Mapping[str, Any], run_name: str) -> Logger:
    from lightning.pytorch.loggers import Logger

    key = RUN_NAME.get(name, "")
    named = {key: run_name} if key in settings and settings[key] is None else {}
    try:
        logger = build(settings, f"logger.{name}", **named)
    except BadInput as error:
        if name not in EXTRAS or not isinstance(error.__cause__, ImportError):
            raise
        raise BadInput(
            f"logger={name}: {name} is not installed; pip install 'sci-lightning[{name}]', or logger=tensorboard"
        ) from error
    if not isinstance(logger, Logger):
        raise BadInput(f"logger.{name}: its _target_ is {with_article(type(logger).__name__)}, not a Logger")
    return logger
