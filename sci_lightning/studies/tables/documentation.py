"""The measured tables of README.md and docs/: written from the JSON files under docs/results/, never by hand.

A page marks the place of a table with two comments, which Markdown does not show:

    <!-- table: KIND, from docs/results/FILE.json -->
    <!-- end -->

KIND is one of :data:`sci_lightning.studies.tables.documented.KINDS`, or ``KIND.PART``. A figure in a sentence is marked
likewise: ``<!-- value: KEY, from FILE -->28.36<!-- end -->`` is KEY in the last row of a ``sci-measurements`` file.
``python -m sci_lightning.tables documentation=.`` writes what lies between the comments;
tests/documentation/test_measured_tables.py compares it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.files.atomic_file import atomic_write
from sci_lightning.files.json_file import read_json
from sci_lightning.studies.tables.documented import KINDS, Measurements, measurements

MARKED = re.compile(r"^<!-- table: (?P<kind>[\w.]+), from (?P<path>\S+) -->\n(?P<body>.*?)^<!-- end -->$", re.M | re.S)

VALUE = re.compile(r"<!-- value: (?P<key>\w+), from (?P<path>\S+) -->[^<\n]*<!-- end -->")


def pages(root: str | Path) -> list[Path]:
    """Return README.md, every page below docs/ and every model card of a clone of the repository."""
    root = Path(root)
    cards = (root / "sci_lightning" / "weights").glob("*.md")
    return [root / "README.md", *sorted((root / "docs").rglob("*.md")), *sorted(cards)]


def updated(page: str | Path, root: str | Path) -> str:
    """Return the text of a page with its tables as the JSON files say.

    Raises:
        BadInput: a marker without its end, a kind of table or a file that is not there, or a file of no use.
    """
    page = Path(page)
    root = Path(root)
    text = page.read_text(encoding="utf-8")
    if text.count("<!-- table: ") != len(MARKED.findall(text)):
        raise BadInput(f"{page}: expected <!-- table: KIND, from PATH --> and <!-- end --> on lines of their own")
    text = MARKED.sub(lambda match: _filled(match, page, root), text)
    return VALUE.sub(lambda match: _value(match, page, root), text)


def update_pages(root: str | Path) -> list[Path]:
    """Write the tables of every page anew; returns the pages that were changed.

    Raises:
        BadInput: see :func:`updated`; no page is changed then.
    """
    root = Path(root)
    if not (root / "README.md").is_file():
        raise BadInput(f"documentation={root}: no README.md there; give the folder of a clone of the repository")
    texts = {page: updated(page, root) for page in pages(root)}
    changed = [page for page, text in texts.items() if text != page.read_text(encoding="utf-8")]
    for page in changed:
        with atomic_write(page) as temporary:
            temporary.write_text(texts[page], encoding="utf-8")
    return changed


def table_sources(root: str | Path) -> Iterator[tuple[Path, str, Path]]:
    """Yield the page, the kind and the path of every table."""
    root = Path(root)
    for page in pages(root):
        for match in MARKED.finditer(page.read_text(encoding="utf-8")):
            yield page, match["kind"], root / match["path"]


def _filled(match: re.Match[str], page: Path, root: Path) -> str:
    kind, path = match["kind"], root / match["path"]
    name, _, part = kind.partition(".")
    if not path.exists() and path.suffix:  # folders of results are there as soon as there is a result
        raise BadInput(f"{page}: table {kind}: {match['path']} does not exist")
    if name not in KINDS:
        raise BadInput(f"{page}: no kind of table is called {name}; choose one of {', '.join(KINDS)}")
    table = KINDS[name](path, part)
    # a blank line on either side: GitHub takes what follows a comment directly for a part of it
    return f"<!-- table: {kind}, from {match['path']} -->\n\n{table.as_markdown()}\n<!-- end -->"


def _value(match: re.Match[str], page: Path, root: Path) -> str:
    key, path = match["key"], root / match["path"]
    rows = measurements(path, "").rows
    keys = [column.key for column in read_json(path, Measurements).columns]
    if key not in keys or not rows:
        raise BadInput(f"{page}: value {key}: {match['path']} has no row with such a column")
    return f"<!-- value: {key}, from {match['path']} -->{rows[-1][keys.index(key)]}<!-- end -->"
