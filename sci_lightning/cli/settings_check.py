"""A command's own settings, found in its configuration and checked before Hydra makes any folder."""

from __future__ import annotations

from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from sci_lightning.cli.settings import SETTINGS, check_settings
from sci_lightning.errors import BadInput


class Refused(BaseException):
    """Ends a command whose settings cannot be used; ``__cause__`` says why.

    It is no ``Exception`` because Hydra turns those into warnings when a callback raises them.
    """


class CheckBeforeWriting(Callback):
    """Checks the settings when they are composed; Hydra makes the folder ``out`` only afterwards.

    Raises:
        Refused: a setting that is missing, cannot be resolved, or is of another type or out of its range.
    """

    def on_run_start(self, config: DictConfig, config_name: str | None = None, **kwargs: Any) -> None:
        try:
            if missing := [str(key) for key in config if key in SETTINGS and OmegaConf.is_missing(config, key)]:
                raise BadInput(f"give {missing[0]}=..; --help says what it is")
            check_command_settings(config, str(config_name))
        except Exception as error:
            raise Refused from error

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        try:  # every other setting may be one of those that the sweep varies; its runs check themselves
            check_settings({"out": config.get("out")}, nullable=())
        except Exception as error:
            raise Refused from error


def check_command_settings(cfg: DictConfig, command: str) -> None:
    """Check the values at the top of a composed configuration that are no groups.

    Args:
        cfg: of a command; settings that are still missing are left out.
        command: the name of its file in ``conf/``. A setting that is null there may be null.

    Raises:
        BadInput: see :func:`~sci_lightning.cli.settings.check_settings`.
    """
    from sci_lightning.configuration.conf_folder import CONF

    present = [str(key) for key in cfg if key in SETTINGS and not OmegaConf.is_missing(cfg, key)]
    settings = OmegaConf.to_container(OmegaConf.create({key: cfg[key] for key in present}))
    assert isinstance(settings, dict)
    defaults = OmegaConf.load(CONF / f"{command}.yaml")
    assert isinstance(defaults, DictConfig)
    for key in ("size", "crop"):
        if isinstance(side := settings.get(key), int) and not isinstance(defaults.get(key), int):
            raise BadInput(f"{key}={side}: expected [height,width]; of a square {key}=[{side},{side}]")
    nullable = [str(key) for key, value in defaults.items_ex(resolve=False) if value is None]
    check_settings({str(key): value for key, value in settings.items()}, nullable)
