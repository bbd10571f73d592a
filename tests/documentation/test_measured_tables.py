"""The measured tables of README.md and docs/ are what the JSON files under docs/results/ say."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.studies.tables.documentation import MARKED, pages, table_sources, updated
from tests.conftest import ROOT
from tests.documentation.pages import name
from tests.files.formats import check
from tests.studies.tables.conftest import Made, made

__all__ = ["made"]  # the fixture

MARKER = "<!-- table: measurements, from docs/results/a.json -->\n<!-- end -->\n"
ABOUT = {"machine": "an abacus", "date": "2026-11-22", "commit": "0123abcd", "scale": "smoke", "seeds": "0, 1"}
CONTENT = {
    "format": "sci-measurements",
    "format_version": 1,
    "provenance": {**ABOUT, "command": "make smoke-tables"},
    "columns": [
        {"key": "name", "title": "decoder"},
        {"key": "psnr", "title": "PSNR (dB)", "digits": 2},
        {"key": "scores", "title": "scores", "digits": [2, 3]},
    ],
    "rows": [{"name": "`gap_tv`", "psnr": 28.567, "scores": [1, 0.8444]}, {"name": "desci"}],
    "notes": ["A note."],
}


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A small clone of the repository with one table."""
    (tmp_path / "docs" / "results").mkdir(parents=True)
    (tmp_path / "docs" / "results" / "a.json").write_text(json.dumps(CONTENT))
    (tmp_path / "README.md").write_text(f"Before.\n\n{MARKER}\nAfter.\n")
    return tmp_path


@pytest.mark.parametrize("page", pages(ROOT), ids=name)
def test_a_page_shows_what_its_files_say(page: Path) -> None:
    assert page.read_text() == updated(page, ROOT), "make documentation writes the tables anew"


def test_every_file_of_measurements_is_shown_and_follows_its_schema() -> None:
    shown = {path for _, _, path in table_sources(ROOT)}
    for path in (ROOT / "docs" / "results").rglob("*.json"):
        if path.name == "relay.json":  # a queue; what its trainings reach is kept below tables/
            continue
        assert shown & {path, *path.parents}, f"{name(path)} is in no table"
        content = json.loads(path.read_text())
        if content.get("format") == "sci-measurements":
            check("measurements", content)
        if "provenance" in content and content["format"] != "sci-proving-ground-case":  # its folder's summary says so
            assert content["provenance"].get("command"), f"{name(path)} does not say by which command it was made"


def test_figures_of_the_text_stand_in_a_table() -> None:
    """What the text says in dB is in a table that a file under docs/results/ says."""
    texts = {page: page.read_text() for page in pages(ROOT)}
    measured = set(
        re.findall(r"\d+\.\d+", " ".join(match["body"] for text in texts.values() for match in MARKED.finditer(text)))
    )
    for page, text in texts.items():
        prose = re.sub(r"^```.*?^```", "", MARKED.sub("", text), flags=re.M | re.S)
        said = set(re.findall(r"(\d+\.\d+) dB", prose))
        assert said <= measured, f"{name(page)}: {sorted(said - measured)} dB in no measured table"


def test_a_table_shows_values_notes_and_provenance(clone: Path, ran: Callable[..., str]) -> None:
    assert "README.md: tables written" in ran("tables", f"documentation={clone}")
    text = (clone / "README.md").read_text()
    assert text.startswith("Before.\n\n<!-- table: measurements") and text.endswith("<!-- end -->\n\nAfter.\n")
    assert "| decoder | PSNR (dB) | scores |\n| --- | ---: | ---: |\n" in text
    assert "| `gap_tv` | 28.57 | 1.00 / 0.844 |\n| desci |  |  |\n\nA note.\n" in text
    sentence = "an abacus; 2026-11-22; commit 0123abcd; scale: smoke; seeds: 0, 1. Made by `make smoke-tables`."
    assert f"*{sentence}*" in text
    assert "is as its file says" in ran("tables", f"documentation={clone}")


def test_a_figure_in_a_sentence_is_that_of_the_last_row(clone: Path, ran: Callable[..., str]) -> None:
    page, rows = clone / "README.md", [{"name": "old", "psnr": 20}, {"name": "new", "psnr": 28.567}]
    marked = "It reaches <!-- value: psnr, from docs/results/a.json -->1<!-- end --> dB.\n\n"
    page.write_text(marked + MARKER)
    (clone / "docs" / "results" / "a.json").write_text(json.dumps(CONTENT | {"rows": rows}))
    assert "README.md: tables written" in ran("tables", f"documentation={clone}")
    assert page.read_text().startswith(marked.replace(">1<", ">28.57<"))
    page.write_text(marked.replace("psnr", "ssim"))
    with pytest.raises(BadInput, match=r"value ssim: .* no row with such a column"):
        updated(page, clone)


def test_a_table_that_differs_from_its_file(clone: Path) -> None:
    (clone / "README.md").write_text(updated(clone / "README.md", clone).replace("28.57", "29.57"))
    assert updated(clone / "README.md", clone) != (clone / "README.md").read_text()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (MARKER.replace("a.json", "b.json"), "docs/results/b.json does not exist"),
        (MARKER.replace("measurements", "guesses"), "no kind of table is called guesses; choose one of"),
        (MARKER.replace("<!-- end -->", ""), "expected <!-- table: KIND, from PATH --> and <!-- end -->"),
    ],
)
def test_markers_of_no_use(text: str, reason: str, clone: Path, refused: Callable[..., str]) -> None:
    (clone / "README.md").write_text(text)
    assert reason in refused("tables", f"documentation={clone}")
    assert (clone / "README.md").read_text() == text


def test_files_of_no_use(clone: Path) -> None:
    path = clone / "docs" / "results" / "a.json"
    for change, reason in [
        ({"format": "sci-metrics"}, "expected format sci-measurements 1"),
        ({"rows": [{"name": "a", "ssim": 1}]}, "rows hold ssim, which no column shows"),
        ({"rows": [{"psnr": [1, 2]}]}, "psnr has 2 values and digits for 1"),
        ({"provenance": {**ABOUT, "commit": None}}, "provenance.commit: "),
    ]:
        path.write_text(json.dumps(CONTENT | change))
        with pytest.raises(BadInput, match=reason):
            updated(clone / "README.md", clone)
    shutil.rmtree(clone / "docs")
    assert MARKED.search((clone / "README.md").read_text())


def test_tables_of_the_paper_show_the_rows_that_are_kept(clone: Path, made: Made) -> None:
    """Nothing as long as there are no rows; then those rows, with the days and commits of all of them."""
    page, tables = clone / "README.md", clone / "docs" / "results" / "tables"
    page.write_text(MARKER.replace("measurements", "paper.rows").replace("a.json", "tables/cpu"))
    assert "*Not yet run.*" in updated(page, clone)
    for seed, day in ((0, "2026-11-22"), (1, "2026-11-24")):
        path = made("row", "rsw_sr", "res2former", 30 + seed, bits=4, seed=seed, scale="cpu")
        content = {**json.loads(path.read_text()), "provenance": {**ABOUT, "date": day, "seeds": str(seed)}}
        content["clips_seen"] = 16_000
        kept = tables / "cpu" / "row" / f"seed{seed}.json"
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(content))
    text = updated(page, clone)
    row = "| Res2former | RSw/SR, 4 bits | 1,000 | "
    scores = " % | 30.50 ± 0.71, 0.762 ± 0.018, 45.50 ± 0.71 | 34.95, 0.965, 52.85 | 2 |"
    assert row in text and scores in text and "2026-11-22 to 2026-11-24" in text and "seeds: 0, 1." in text
    page.write_text(MARKER.replace("measurements", "paper.verdicts").replace("a.json", "tables/cpu"))
    assert "4 not yet run" in updated(page, clone)
    page.write_text(MARKER.replace("measurements", "paper.published").replace("a.json", "tables"))
    assert row not in updated(page, clone)  # of a small budget
    kept.write_text(json.dumps(content).replace('"scale": "cpu"', '"scale": "gpu30"'))
    assert row in updated(page, clone)
    kept.write_text("{}")
    with pytest.raises(BadInput, match=r"seed1\.json: .*format sci-metrics 1"):
        updated(page, clone)
    page.write_text(MARKER.replace("measurements", "paper.table9"))
    with pytest.raises(BadInput, match=r"paper\.table9: .* rows, published"):
        updated(page, clone)


def test_every_row_says_what_it_took() -> None:
    """Network, camera, parameters, computation, scores and seeds, and below the command."""
    for page in pages(ROOT):
        for match in MARKED.finditer(page.read_text()):
            if match["kind"] in ("paper.rows", "paper.published"):
                rows = re.findall(r"^\| (?!---|network)(.*) \|$", match["body"], re.M)
                empty = [row for row in rows if not all(cell.strip() for cell in row.split(" | ")[:5])]
                assert rows and not empty, f"{name(page)}: {empty}"
                assert "Made by `python -m" in match["body"], f"{name(page)}: {match['kind']} names no command"


def test_no_clone(tmp_path: Path, refused: Callable[..., str]) -> None:
    assert "no README.md there" in refused("tables", f"documentation={tmp_path}")
    assert "give runs=DIR" in refused("tables")
