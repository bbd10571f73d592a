"""Where a training is logged: ``logger=tensorboard``, ``'logger=[tensorboard,csv]'``, ..."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sci_lightning.configuration.build import build
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import with_article

if TYPE_CHECKING:  # a command without a logger starts without Lightning, which takes seconds to import
    from lightning.pytorch.loggers import Logger

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
    from lightning.pytorch.loggers import Logger

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
