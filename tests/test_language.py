"""The words of the code: names say what a thing is, and docstrings are sentences (docs/glossary.md)."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

import sci_lightning

PACKAGE = Path(sci_lightning.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))

DIALECT = {
    "each": "name the thing: effect, row, capture",
    "found": "say what was found, or what is returned: matches, effects, estimate",
    "told": "commanded, stated, given",
    "chart": "fixed-pattern map",
    "charts": "fixed-pattern maps",
    "pull": "gradient",
    "toll": "penalty",
    "held": "held-out",
    "lever": "leverage",
    "worth": "gain",
    "settle": "prune, converge",
    "leftover": "remaining misfit",
    "likeliest": "most likely",
    "whole_file": "atomic_write",
}
"""Names that a reader from outside cannot guess, and what to say instead."""

CONTRACT = {("encoder/encoder.py", "told")}
"""Names that the user's settings have: ``encoder.told``."""

PARTS = re.compile(r"(^|_)(each|told|chart|charts|toll|whole_file)(_|$)|^chosen_")
"""Parts of names that are dialect wherever they stand."""


def names(tree: ast.AST) -> set[tuple[str, int]]:
    """Every name that a file defines, with its line: variables, arguments, functions, classes and attributes."""
    defined: set[tuple[str, int]] = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            defined.add((node.name, node.lineno))
        elif isinstance(node, ast.arg):
            defined.add((node.arg, node.lineno))
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            defined.add((node.id, node.lineno))
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            defined.add((node.attr, node.lineno))
    return defined


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_names(file: Path) -> None:
    tree, path = ast.parse(file.read_text()), str(file.relative_to(PACKAGE))
    wrong = [
        f"line {line}: {name}: {DIALECT.get(name, 'DESIGN.md, Language')}"
        for name, line in sorted(names(tree), key=lambda entry: entry[1])
        if (name in DIALECT or PARTS.search(name.lower())) and (path, name) not in CONTRACT
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_docstrings(file: Path) -> None:
    """A docstring is a sentence that says what a thing is or does: none begins with "Of", each ends with a mark."""
    wrong = []
    for node in ast.walk(ast.parse(file.read_text())):
        if not isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        text = ast.get_docstring(node)
        if text is None or getattr(node, "name", "").startswith("_"):
            continue
        first = text.split("\n\n")[0].strip()
        if re.match(r"(Of|So many)\b", first) or not first.endswith((".", ":", "?", "::", "!", "``")):
            wrong.append(f"line {getattr(node, 'lineno', 1)}: {first.splitlines()[0]}")
    assert not wrong, "\n".join(wrong)


def test_no_folder_is_crowded() -> None:
    """At most 20 modules in a folder, 24 packages at the top beside what starts a command, no file above 400 lines."""
    commands = {file.name for file in (PACKAGE / "cli" / "commands").glob("*.py")} | {"tables", "mismatch"}
    files = [file for file in FILES if file.parent != PACKAGE or file.name not in commands - {"__init__.py"}]
    folders = Counter(str(file.parent.relative_to(PACKAGE)) for file in files)
    assert not {folder: count for folder, count in folders.items() if count > 20}
    top = {file.relative_to(PACKAGE).parts[0] for file in files} - {"__init__.py", "__main__.py"}
    assert len(top - commands) <= 24, sorted(top - commands)
    assert not [str(file) for file in FILES if len(file.read_text().splitlines()) > 400]
