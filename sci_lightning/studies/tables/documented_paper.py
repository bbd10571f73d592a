"""The rows of the paper's tables that are kept, with what each took, and verdicts on the paper's claims.

``paper.rows`` are those of one folder, ``paper.published`` those of published networks in all folders,
``paper.verdicts`` a line for each claim.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.plain_text import in_markdown
from sci_lightning.runs.provenance import NOT_YET, Provenance, joined
from sci_lightning.studies.tables.claim_table import verdict_table
from sci_lightning.studies.tables.cost import share_of_paper
from sci_lightning.studies.tables.grid import DocumentedTable
from sci_lightning.studies.tables.line import Line, lines_of
from sci_lightning.studies.tables.paper_figures import paper_figures
from sci_lightning.studies.tables.run import ScoredRun, find_runs
from sci_lightning.studies.tables.score_table import SCORES, scores, seeds

ENCODERS = {
    ("rbw_osr", "rbw_osr"): "RBw/oSR",
    ("rbw_osr", "rbw_sr"): "RBw/oSR, tested through RBw/SR",
    ("rbw_sr", "rbw_sr"): "RBw/SR",
    ("rsw_sr", "rsw_sr"): "RSw/SR",
    ("lsw_sr", "lsw_sr"): "LSw/SR",
    ("fsw_sr", "fsw_sr"): "FSw/SR",
    ("lsw_index_sr", "lsw_index_sr"): "LSw/SR, one index per pixel",
}
"""Cameras, by the encoders of training and test; the last two are controls of ours."""
ROWS = ["network", "camera", "parameters", "computation", f"ours: {SCORES}", "the paper's", "seeds"]
NOTE = (
    "Computation: 6 x multiply-accumulates x clips seen, as a part of the published. Behind ±: the standard deviation "
    "over the seeds."
)
SMALL_BUDGETS = "cpu"
"""How the names of scales begin whose rows are a study of masks and recipes, and not of the published networks."""


def paper_table(path: str | Path, part: str) -> DocumentedTable:
    """Return the rows that are kept in a folder, or what they say of the paper's claims.

    Args:
        path: the folder, such as ``docs/results/tables/cpu``; for ``published`` the one above. As long as it is not
            there, the table is empty.
        part: ``rows``, ``published`` or ``verdicts`` (a line for each claim); for the last, what lies in the folders
            beside ``path`` are controls.

    Raises:
        BadInput: another part, or a file of no use.
    """
    path, paper = Path(path), paper_figures()
    if part == "published":
        folders = [runs for folder in _folders(path) if (runs := _runs(folder)) and not _is_small(runs)]
    elif part in ("rows", "verdicts"):
        folders = [_runs(path)]
    else:
        raise BadInput(f"paper.{part}: no such table; choose one of rows, published, verdicts")
    runs = [run for folder in folders for run in folder]
    if part == "verdicts":
        others = [run for folder in _folders(path.parent) if folder != path for run in _runs(folder)]
        grid = verdict_table(paper, runs, None, others)
        heading, *rows = [[claim, *verdicts] for claim, _, *verdicts, _ in (grid.heading, *grid.rows)]
        notes = grid.notes
    else:
        heading, rows, notes = ROWS, [row for folder in folders for row in _rows(paper, folder)], [NOTE]
    texts = [[in_markdown(cell) for cell in row] for row in (heading, *rows)]
    return DocumentedTable(texts[0], texts[1:], _provenance(runs), [in_markdown(note) for note in notes])


def _folders(path: Path) -> list[Path]:
    return sorted(folder for folder in path.iterdir() if folder.is_dir()) if path.is_dir() else []


def _runs(path: Path) -> list[ScoredRun]:
    runs, lines = find_runs([path]) if path.is_dir() else ([], [])
    if lines:
        raise BadInput(lines[0])
    return runs


def _is_small(runs: Sequence[ScoredRun]) -> bool:
    return all(run.setting.scale.startswith(SMALL_BUDGETS) for run in runs)


def _rows(paper: Mapping[str, Any], runs: Sequence[ScoredRun]) -> list[list[str]]:
    """Return a row for each network and camera that was trained; those of the paper's tables first, in its order."""
    tables = paper["tables"]
    names = {row["match"]["decoder"]: name for key in ("table2", "table4") for name, row in tables[key]["rows"].items()}
    lines = [
        line for key in ("table2", "table3", "table5", "table4") for line in lines_of(tables[key], runs) if line.runs
    ]
    others: dict[Any, list[ScoredRun]] = defaultdict(list)
    for run in sorted(runs, key=lambda run: (str(run.fields), run.seed)):
        if not any(run in line.runs for line in lines):
            others[str(run.fields), run.group].append(run)
    lines += [Line("", "", {}, tuple(group), str(group[0].fields["decoder"])) for group in others.values()]
    rows = {}
    for line in lines:
        first, fields = line.runs[0], line.runs[0].fields
        camera = ENCODERS.get((str(fields["encoder"]), str(fields["test_encoder"])), str(fields["encoder"]))
        bits = "" if "RBw" in camera else f"{fields['bits']} bit{'s' * (fields['bits'] != 1)}"
        camera = ", ".join([camera, *filter(None, [bits]), *first.variant])
        rows[line.decoder, camera] = [
            names.get(line.decoder, line.decoder),
            camera,
            f"{first.parameters:,}",
            _computation(paper, line),
            scores(line.mean(), line.spread()),
            scores(line.paper),
            seeds(line.runs),
        ]
    return list(rows.values())


def _computation(paper: Mapping[str, Any], line: Line) -> str:
    """The computation of the trainings as a part of the published one's, in percent; their mean."""
    macs = {name: figures["macs_G"] for name, figures in paper["decoders"].items()} | paper["counted"]
    shares = [
        share
        for run in line.runs
        if line.decoder in macs and (share := share_of_paper(run, 1e9 * macs[line.decoder])) is not None
    ]
    return f"{100 * statistics.fmean(shares):.2g} %" if shares else ""


def _provenance(runs: Sequence[ScoredRun]) -> Provenance:
    if not runs:
        return NOT_YET
    if missing := [run.path for run in runs if run.provenance is None]:
        raise BadInput(f"{missing[0]}: does not say where, when and with what it was trained (provenance)")
    return joined([run.provenance for run in runs if run.provenance])
