"""The site: it is built without a warning, every page is in its contents, and every notebook runs."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

from tests.conftest import ROOT

DOCS = ROOT / "docs"
NOTEBOOKS = sorted((DOCS / "tutorials").glob("*.ipynb"))
LONG = ("calibrate-and-diagnose", "diagnose-from-snapshots", "learn-a-mask-and-a-decoder", "sweeps-tables-dashboards")
"""Notebooks that take more than a few seconds."""
NEEDS_TORCHVISION = ("deepinv",)
"""Notebooks that the build executes only where deepinv can be imported; tests/encoder/test_physics.py tests what they
show."""

FIRST = {
    "full_scale": "how-to/camera-files",
    "LZW": "how-to/camera-files",
    "Slurm": "how-to/cluster",
    "zsh": "how-to/first-hour",
}
"""What a reader looks for, and the page that the site's search shows first."""


def cells(notebook: Path) -> list[dict[str, Any]]:
    return list(json.loads(notebook.read_text())["cells"])


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_holds_no_results(notebook: Path) -> None:
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells(notebook))


@pytest.mark.parametrize(
    "notebook",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem in LONG else [])
        for path in NOTEBOOKS
        if path.stem not in NEEDS_TORCHVISION
    ],
)
def test_a_notebook_runs(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, object] = {}
    for number, cell in enumerate(cells(notebook)):
        if cell["cell_type"] == "code" and "skip-execution" not in cell["metadata"].get("tags", []):
            exec(compile("".join(cell["source"]), f"{notebook.name}, cell {number}", "exec"), names)
    plt.close("all")
    sys.modules.pop("my_parts", None)


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """A page in no table of contents, a link that leads nowhere and a docstring that is no markup are warnings."""
    build = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet", str(DOCS), str(tmp_path)]
    done = subprocess.run(build, env={**os.environ, "NOTEBOOKS": "off"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    words = (tmp_path / "searchindex.js").read_text()
    assert all(word in words for word in ("full_scal", "lzw", "slurm", "zsh"))
    if node := shutil.which("node"):
        search = [node, str(Path(__file__).with_name("search.js")), str(tmp_path), *FIRST]
        assert subprocess.run(search, capture_output=True, text=True).stdout.split() == list(FIRST.values())
    for page in set(tmp_path.rglob("*.html")) - set((tmp_path / "_static").rglob("*")):
        text = page.read_text()
        for target in re.findall(r'(?:href|src)="([^"#:?]+)[^":]*"', text):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_pages_are_short() -> None:
    """35,000 words in all, and 1,500 on a page of results."""
    words = {page: len(page.read_text().split()) for page in DOCS.rglob("*.md")}
    assert sum(words.values()) <= 35_000
    assert not [page.name for page, count in words.items() if page.parent.name == "results" and count > 1500]
