"""The arguments of our own classes, read from their source: wrong values are refused before torch is loaded.

The annotations of ``__init__`` are the only place where types and ranges of its
arguments stand. Here their text is read and
interpreted with what the module imports from :mod:`sci_lightning.configuration.bounds` and the standard library; an
annotation that needs anything else, such as a tensor's type, is left to the check when the object is built.
"""

from __future__ import annotations

import ast
import builtins
import importlib
from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from sci_lightning.configuration.arguments import check_value, refuse_unknown
from sci_lightning.configuration.library_bounds import LIBRARY_BOUNDS

LIGHT = ("typing", "collections.abc", "pathlib", "annotated_types", "sci_lightning.configuration.bounds")
"""Modules that annotations are taken from."""

READ = ("sci_lightning", "lightning")
"""Packages whose source is read; of others nothing is known before they are imported."""


def check_parts(content: Any, key: str) -> None:
    """Check the arguments of everything that a configuration builds, as far as their source says what they may be.

    Args:
        content: plain data; mappings with ``_target_`` are to be built. Values that are None or missing are left out.
        key: where it stands, for messages.

    Raises:
        BadInput: as :func:`~sci_lightning.configuration.arguments.check_arguments`.
    """
    if isinstance(content, (list, tuple)):
        for number, entry in enumerate(content):
            check_parts(entry, f"{key}[{number}]")
    if not isinstance(content, Mapping):
        return
    target = content.get("_target_")
    signature = _signature(target) if isinstance(target, str) else None
    for name, value in content.items():
        entry_key = f"{key}.{name}"
        if _is_built(value) or signature is None:
            check_parts(value, entry_key)
        elif name not in ("_target_", "_partial_"):
            class_name, known, open_ended = signature
            refuse_unknown([name], known, open_ended, key, class_name)
            of_a_square = name in ("size", "crop") and isinstance(value, int)  # which commands turn into two sides
            if value is not None and value != "???" and not of_a_square:
                check_value(entry_key, value, known.get(name, Any))


def _is_built(value: Any) -> bool:
    if isinstance(value, Mapping):
        return "_target_" in value or any(map(_is_built, value.values()))
    return isinstance(value, (list, tuple)) and any(map(_is_built, value))


@cache
def _signature(target: str) -> tuple[str, dict[str, Any], bool] | None:
    """Return the class's name, its arguments' annotations, and whether others are taken; None if it is not known."""
    module, node = _definition(target) or ("", None)
    if not isinstance(node, ast.ClassDef):
        return None
    bounds, known = LIBRARY_BOUNDS.get(f"{module}.{node.name}", {}), dict[str, Any]()
    name = node.name
    while True:
        init = next((f for f in node.body if isinstance(f, ast.FunctionDef) and f.name == "__init__"), None)
        for argument in [*init.args.args[1:], *init.args.kwonlyargs] if init else []:
            own = module.partition(".")[0] == "sci_lightning"
            annotation = _value(module, argument.annotation) if own and argument.annotation else Any
            known.setdefault(argument.arg, bounds.get(argument.arg, annotation))
        if init is not None and init.args.kwarg is None:
            return name, known, False
        base = node.bases[0] if node.bases else None
        above = _definition(f"{module}.{base.id}") if isinstance(base, ast.Name) else None
        module, parent = above or ("", None)
        if not isinstance(parent, ast.ClassDef):
            return name, known, True
        node = parent


@cache
def _definition(path: str) -> tuple[str, ast.stmt] | None:
    """Return the module in which a dotted name is defined, and the statement that does; imports are followed."""
    module, _, name = path.rpartition(".")
    tree = _source(module)
    for node in tree.body if tree else ():
        if isinstance(node, ast.ClassDef) and node.name == name:
            return module, node
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                if name == (alias.asname or alias.name):
                    return (node.module, node) if node.module in LIGHT else _definition(f"{node.module}.{alias.name}")
        names = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        if any(isinstance(target, ast.Name) and target.id == name for target in names):
            return module, node
    return None


@cache
def _source(module: str) -> ast.Module | None:
    package, *parts = module.split(".")
    spec = find_spec(package) if package in READ else None
    if spec is None or spec.origin is None:
        return None
    file = Path(spec.origin).parent.joinpath(*parts)
    file = file / "__init__.py" if file.is_dir() else file.with_suffix(".py")
    return ast.parse(file.read_text(encoding="utf-8")) if file.is_file() else None


def _value(module: str, expression: ast.expr) -> Any:
    """Return what an annotation stands for; ``Any`` where that is not known without loading more."""
    try:
        return eval(compile(ast.Expression(expression), module, "eval"), {"__builtins__": {}}, _Names(module))
    except Exception:  # a name that only a heavy module has, or something that is no type
        return Any


class _Names(dict[str, Any]):
    """The names of a module of ours, each looked up when an annotation uses it."""

    def __init__(self, module: str) -> None:
        super().__init__()
        self.module = module

    def __missing__(self, name: str) -> Any:
        definition = _definition(f"{self.module}.{name}")
        if definition is None:
            return getattr(builtins, name)
        module, node = definition
        if isinstance(node, ast.ImportFrom):
            original = next(alias.name for alias in node.names if name == (alias.asname or alias.name))
            return getattr(importlib.import_module(module), original)
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            return eval(compile(ast.Expression(node.value), module, "eval"), {"__builtins__": {}}, _Names(module))
        raise NameError(name)
