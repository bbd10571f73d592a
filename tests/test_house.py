"""The layout: packages in an order, imports that point down in it, no circles; `python -m tests.test_house` counts it.

The order is that of the map in docs/explanation/repository-layout.md.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from statistics import median

from sci_lightning.configuration.conf_folder import PACKAGE
from tests.conftest import ROOT

LAYOUT = ROOT / "docs" / "explanation" / "repository-layout.md"
FILES = sorted(PACKAGE.rglob("*.py"))
STARTS = {file.name for file in (PACKAGE / "cli" / "commands").glob("*.py")} | {"__main__.py", "__init__.py"}
"""Files at the top that start a command or show the library's face: they stand outside of the order."""


def starts_a_command(file: Path) -> bool:
    """Whether a file is one that ``python -m`` starts, which only calls its command, or the package's face."""
    place = file.relative_to(PACKAGE)
    if place.parts[0] in ("tables", "mismatch"):
        return True
    return (len(place.parts) == 1 and place.name in STARTS) or str(place) in (
        "captures/__main__.py",
        "virtual_camera/__main__.py",
        "virtual_camera/reveal.py",
    )


def levels() -> list[list[str]]:
    """Return the packages of each line of the map, from those that import nothing up."""
    drawn = re.search(r"^sci_lightning/\n(.*?)^tests/", LAYOUT.read_text(), re.DOTALL | re.MULTILINE)
    assert drawn is not None
    heads = [re.match(r"  ((?:\w+(?:/|\.py) )+)", line) for line in drawn[1].splitlines()]
    return [re.findall(r"(\w+)(?:/|\.py)", head[1]) for head in heads if head]


def module_of(file: Path) -> str:
    """Return the dotted name of a file of the package."""
    parts = [PACKAGE.name, *file.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(file: Path, modules: set[str]) -> Iterator[str]:
    """Yield the modules of the package that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom) and node.module in modules:
            inside = {f"{node.module}.{alias.name}" for alias in node.names} & modules
            yield from inside or {node.module}


@cache
def arrows() -> dict[str, set[str]]:
    """Return the modules that each module imports; files that start a command are left out."""
    files = {module_of(file): file for file in FILES if not starts_a_command(file)}
    return {name: set(imports_of(file, set(files))) - {name} for name, file in files.items()}


def upward() -> list[str]:
    """Return the imports that point up, file by file."""
    order = {package: level for level, packages in enumerate(levels()) for package in packages}
    found = []
    for name, others in arrows().items():
        here = name.split(".")[1]
        for other in sorted(others):
            there = other.split(".")[1]
            if here != there and order[there] >= order[here] and order[there] != order[here]:
                found.append(f"{name} imports {other}")
    return found


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of nodes that reach each other (Tarjan's strongly connected components of two and more)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(graph.get(node, ())):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(sorted(group))

    for node in graph:
        if node not in index:
            visit(node)
    return found


def packages() -> dict[str, set[str]]:
    """Return the packages that each package imports from."""
    graph: dict[str, set[str]] = defaultdict(set)
    for name, others in arrows().items():
        graph[name.split(".")[1]] |= {other.split(".")[1] for other in others} - {name.split(".")[1]}
    return graph


def test_imports_point_down() -> None:
    assert not upward()


def test_no_two_packages_import_each_other() -> None:
    assert not circles(packages())


def test_no_circle_of_files() -> None:
    assert not circles(arrows())


def count() -> dict[str, float]:
    """Return the size of the package."""
    lines = {file: len(file.read_text().splitlines()) for file in FILES}
    other = [file for file in PACKAGE.rglob("*") if file.suffix in (".json", ".yaml", ".html", ".css")]
    return {
        "lines of Python": sum(lines.values()),
        "lines of its data": sum(len(file.read_text().splitlines()) for file in other),
        "files": len(lines),
        "median lines": median(lines.values()),
        "packages": len([package for level in levels() for package in level]),
        "levels": len(levels()),
        "upward imports": len(upward()),
        "circles of packages": len(circles(packages())),
        "circles of files": len(circles(arrows())),
        "YAML files under conf/scale": len([*(ROOT / "conf" / "scale").rglob("*.yaml")]),
    }


if __name__ == "__main__":
    for what, number in count().items():
        print(f"{what}: {number:g}")
    print(*upward(), *circles(arrows()), *circles(packages()), sep="\n")
