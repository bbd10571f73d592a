"""The classes that a file may name: ours, and those of packages that the user trusts."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sci_lightning.errors import BadInput
from sci_lightning.plain_text import excerpt

if TYPE_CHECKING:  # commands that only answer --help do not load torch
    from torch import nn

PACKAGES = (
    "sci_lightning.encoder",
    "sci_lightning.encoder.mask",
    "sci_lightning.encoder.sensor",
    "sci_lightning.encoder.effects",
    "sci_lightning.encoder.free_form",
    "sci_lightning.decoder",
    "sci_lightning.decoder.denoiser",
)
"""Everything that these packages export can be part of an encoder or a decoder in a file."""

BASES = ("Mask", "Decoder", "Denoiser")
"""What the others are made from, and what does nothing by itself."""

NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)


@cache
def registered_classes() -> dict[str, type[nn.Module]]:
    """Our own classes by every dotted name that files of this project have for them."""
    from torch import nn

    classes: dict[str, type[nn.Module]] = {}
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            member = getattr(module, name)
            if inspect.isclass(member) and issubclass(member, nn.Module) and name not in BASES:
                classes[f"{package}.{name}"] = member
                classes[f"{member.__module__}.{member.__qualname__}"] = member
                module_name = member.__module__.rpartition(".")[2]  # files written before effects lay in stages
                classes[f"{package}.{module_name}.{member.__qualname__}"] = member
    return classes


def class_for_file(path: str | Path, target: object, trusted: Iterable[str] = ()) -> type[nn.Module]:
    """The class that a file names as ``_target_``.

    A name of our own is looked up, never imported. A name of a trusted package must be a subclass of ``nn.Module``
    that this package defines itself, so that nothing which it merely imports can be reached through it.

    Args:
        path: the file, for messages.
        target: what stands in the file.
        trusted: packages beside this one.

    Raises:
        BadInput: any other name.
    """
    from torch import nn

    if isinstance(target, str) and (known := registered_classes().get(target)):
        return known
    package = str(target).partition(".")[0]
    if isinstance(target, str) and NAME.fullmatch(target) and package in trusted and package != "sci_lightning":
        module, _, name = target.rpartition(".")
        try:
            member = getattr(importlib.import_module(module), name) if module else None
        except Exception as error:  # whatever the import of somebody's package raises
            raise BadInput(f"{path}: '{target}' cannot be imported ({type(error).__name__}: {error})") from error
        if inspect.isclass(member) and issubclass(member, nn.Module) and member.__module__.partition(".")[0] == package:
            return member
        raise BadInput(f"{path}: '{target}' is not an nn.Module that the package '{package}' defines")
    shown = excerpt(target)
    advice = "name a member of its own packages"
    if isinstance(target, str) and NAME.fullmatch(target) and package != "sci_lightning":
        advice = f"if you trust the package, say so: 'trusted=[{package}]'"
    raise BadInput(f"{path}: asks to build '{shown}', which is not a module of sci_lightning; {advice}")


def check_targets(path: str | Path, content: Any, trusted: Iterable[str] = ()) -> None:
    """Check every ``_target_`` in the plain data of a file, before anything is built.

    Raises:
        BadInput: one that the file may not name, see :func:`class_for_file`.
    """
    packages = tuple(trusted)
    if isinstance(content, Mapping):
        if "_target_" in content:
            class_for_file(path, content["_target_"], packages)
        for value in content.values():
            check_targets(path, value, packages)
    elif isinstance(content, (list, tuple)):
        for value in content:
            check_targets(path, value, packages)
