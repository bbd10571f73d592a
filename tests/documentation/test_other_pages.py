"""The commands of all pages that are no how-to pages, the Python of every page, and what the pages point to."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from tests.conftest import ROOT
from tests.documentation.pages import PAGES, blocks, commands, commands_of, name

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


def test_the_pages_are_there() -> None:
    assert {"make train", "make diagnose", "make test"} <= set(commands(ROOT / "README.md"))
    index = (ROOT / "docs" / "index.md").read_text()
    for page in PAGES[1:]:
        link = page.relative_to(ROOT / "docs").as_posix()
        assert link == "index.md" or f"({link})" in index, f"docs/index.md does not list {link}"


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 200


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


def test_every_room_is_on_the_map() -> None:
    """README's map of the house names every folder of the package, and no folder that is not there."""
    drawn = re.search(r"^sci_lightning/\n(.*?)^tests/", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    assert drawn is not None
    rooms = set(re.findall(r"^  (\w+)/ ", drawn[1], re.MULTILINE))
    there = {folder.parent.name for folder in (ROOT / "sci_lightning").glob("*/__init__.py")}
    assert rooms == there


def test_security_names_files_that_exist() -> None:
    """SECURITY.md says where each promise is kept: paths inside the package, or of tests."""
    paths = re.findall(r"`((?:\w+/)*\w*(?:\.py|/))`", (ROOT / "SECURITY.md").read_text())
    missing = [path for path in paths if not ((ROOT / "sci_lightning" / path).exists() or (ROOT / path).exists())]
    assert len(paths) > 20 and not missing
