"""What a configuration from elsewhere may build: modules of this package, and of those the user trusts."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput


def check_targets(path: str | Path, config: Any, trusted: Iterable[str] = ()) -> None:
    """Check every ``_target_`` of a plain configuration, before anything is built.

    Args:
        path: where the configuration comes from, for the message.
        config: dictionaries, lists and values, resolved.
        trusted: packages beside this one.

    Raises:
        BadInput: one that is not a ``torch.nn.Module`` of a known package.
    """
    known = ("sci_lightning", *trusted)
    for target in _targets(config):
        if not _is_module(target, known):
            raise BadInput(
                f"{path}: asks to build '{target}', which is not a module of sci_lightning; if you trust the package, "
                f"say so: trusted=[{target.split('.')[0]}]"
            )


def _is_module(target: str, known: tuple[str, ...]) -> bool:
    from hydra.utils import get_object
    from torch import nn

    if target.split(".")[0] not in known:
        return False
    try:
        found = get_object(target)
    except Exception:  # a name that leads nowhere: whatever its import raises
        return False
    return inspect.isclass(found) and issubclass(found, nn.Module) and found.__module__.split(".")[0] in known


def _targets(config: Any) -> Iterator[str]:
    if isinstance(config, Mapping):
        for key, value in config.items():
            if key == "_target_":
                yield str(value)
            else:
                yield from _targets(value)
    elif isinstance(config, (list, tuple)):
        for value in config:
            yield from _targets(value)
