"""A system out of a checkpoint: of this project, or one that a trainer of somebody's own has written."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sci_lightning.configuration.arguments import check_arguments
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import load_file, read_checkpoint


def load_system(
    cls: type,
    base: Iterable[str],
    checkpoint_path: Any,
    map_location: Any,
    trusted: Iterable[str],
    settings: dict[str, Any],
) -> Any:
    """Build a system from a checkpoint, see :meth:`.System.load_from_checkpoint`, which says arguments and errors.

    Args:
        cls: the class to build.
        base: names of the settings that every system has, which a subclass hands on.
        checkpoint_path, map_location, trusted, settings: as that method was given them.
    """
    settings.pop("weights_only", None)  # of Lightning: never anything else here
    own = {"encoder", "decoder"} <= settings.keys()
    if own:
        content = load_file(Path(checkpoint_path))
        config, trained = {}, content.get("hyper_parameters", {})
    else:
        checkpoint = read_checkpoint(checkpoint_path, trusted)
        config, trained = checkpoint.config, checkpoint.config.get("system", {})
        settings = {"encoder": checkpoint.encoder(), "decoder": checkpoint.decoder(trainable=True), **settings}
    known = set(base) | inspect.signature(cls).parameters.keys()
    arguments = {**{key: value for key, value in trained.items() if key in known}, **settings}
    check_arguments(cls, arguments, "system")
    system = cls(**arguments, run_config=config)
    if own:
        try:
            system.load_state_dict(content["state_dict"])
        except (RuntimeError, KeyError) as error:
            raise BadInput(f"{checkpoint_path}: does not fit this encoder and decoder ({error})") from error
    return system.to(map_location)
