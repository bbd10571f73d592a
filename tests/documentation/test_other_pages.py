"""The commands of all pages that are no how-to pages, the Python of every page, and what the pages point to."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from PIL import Image

from tests.conftest import ROOT
from tests.documentation.pages import PAGES, blocks, commands, commands_of, name

LAYOUT = ROOT / "docs" / "explanation" / "repository-layout.md"
PYTHON = [page for page in PAGES if blocks(page, "python")]


@pytest.mark.parametrize(
    "command", commands_of(lambda page: page != "README.md" and not page.startswith("docs/how-to/"))
)
def test_command(command: str, run_command: Callable[[str], None]) -> None:
    run_command(command)


@pytest.mark.parametrize("page", PYTHON, ids=name)
def test_python(page: Path, stand_ins: Path) -> None:
    """The Python of a page runs as it stands, one example after the other."""
    names: dict[str, object] = {}
    for example in blocks(page, "python"):
        exec(compile(example, name(page), "exec"), names)
    if "Mine" in names:
        decoder = names["Mine"](8)  # type: ignore[operator]
        assert decoder(torch.rand(2, 16, 16), torch.rand(8, 16, 16)).shape == (2, 8, 16, 16)


def test_the_first_commands() -> None:
    assert {"sci-lightning demo", "make train", "make diagnose", "make test"} <= set(commands(ROOT / "README.md"))


def test_the_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 120 and len(text.split()) <= 900
    assert "**Tell it what your camera recorded" in text and len(PAGES) > 30


def test_the_moving_picture() -> None:
    """It stands on top of the README, is small, and moves."""
    path = ROOT / re.findall(r"^!\[[^]]+\]\((\S+)\)$", (ROOT / "README.md").read_text(), re.MULTILINE)[0]
    with Image.open(path) as picture:
        assert path.suffix == ".gif" and path.stat().st_size < 1.5e6 and picture.n_frames >= 8  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "page", [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "SECURITY.md"], ids=name
)
def test_links(page: Path) -> None:
    """Links to files and to headings of pages lead somewhere, and pictures are pictures."""
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if target.startswith("https://"):
            continue
        file, _, heading = target.partition("#")
        path = (page.parent / file).resolve() if file else page
        assert path.exists(), f"{name(page)}: {target}"
        assert path.suffix != ".png" or path.stat().st_size > 1000
        titles = re.findall(r"^#+ (.*)$", path.read_text(), re.MULTILINE) if heading else []
        anchors = {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}
        assert not heading or heading in anchors, f"{name(page)}: no heading #{heading} in {file or 'it'}"


def test_every_package_is_on_the_map() -> None:
    """The map of the repository names every folder of the package, and no folder that is not there."""
    drawn = re.search(r"^sci_lightning/\n(.*?)^tests/", LAYOUT.read_text(), re.DOTALL | re.MULTILINE)
    assert drawn is not None
    heads = re.findall(r"^  ((?:\w+/ )+)", drawn[1], re.MULTILINE)
    packages = {package for head in heads for package in re.findall(r"\w+", head)}
    there = {folder.parent.name for folder in (ROOT / "sci_lightning").glob("*/__init__.py")}
    assert packages == there


def test_security_names_files_that_exist() -> None:
    """SECURITY.md says where each promise is kept: paths inside the package, or of tests."""
    paths = re.findall(r"`((?:\w+/)*\w*(?:\.py|/))`", (ROOT / "SECURITY.md").read_text())
    missing = [path for path in paths if not ((ROOT / "sci_lightning" / path).exists() or (ROOT / path).exists())]
    assert len(paths) > 20 and not missing
