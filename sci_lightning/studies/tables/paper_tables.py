"""The paper's tables out of runs: what the command ``tables`` and ``sci.tables`` share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sci_lightning.errors import BadInput

if TYPE_CHECKING:
    from sci_lightning.studies.tables.grid import Grid
    from sci_lightning.studies.tables.run import ScoredRun


@dataclass(frozen=True)
class Tables:
    """What was made of the runs.

    Attributes:
        folder: with every table as Markdown, LaTeX and PNG, the figures as PNG, and the dashboard in ``tensorboard/``.
        runs: that were read.
        grids: the tables by name; ``print(tables.grids["table1"].as_markdown())`` shows one.
        figures: files of the figures, by name.
        left_out: a line for every file that is of no use, and why.
    """

    folder: Path
    runs: tuple[ScoredRun, ...]
    grids: dict[str, Grid]
    figures: dict[str, Path]
    left_out: tuple[str, ...]


def make_tables(
    config: Mapping[str, Any],
    decoders: Mapping[str, Any],
    encoders: Mapping[str, Any],
    on_left_out: Callable[[str], None] = lambda line: None,
) -> Tables:
    """Collect the ``metrics.json`` below ``runs``, and write each table as Markdown, LaTeX and PNG into ``out``.

    Beside them the paper's figures as PNG: quality against cost, dynamic range, mosaics of runs that left a checkpoint.
    With ``dashboard=true`` a TensorBoard log as well, in which every run is a trial.

    Args:
        config: ``conf/tables.yaml``, composed, resolved and plain.
        decoders: plain configurations for 8 frames of those that the paper has, by name.
        encoders: plain configurations of encoders for 8 frames of 32 x 32, by name.
        on_left_out: called with a line for every file that is of no use; the others go on.

    Raises:
        BadInput: no folder is given, none of them holds a run, or another dashboard is in the way.
    """
    from sci_lightning.figures.figure import write_figure
    from sci_lightning.studies.figures.dynamic_range import (
        colour_checkers,
        dynamic_range_figure,
        dynamic_range_table,
        wedges,
    )
    from sci_lightning.studies.figures.mosaic import mosaics, retrained_mosaics
    from sci_lightning.studies.tables.claim_table import claim_table, verdict_table
    from sci_lightning.studies.tables.cost import cost_figure, costs
    from sci_lightning.studies.tables.dashboard import check_dashboard, write_dashboard
    from sci_lightning.studies.tables.paper_figures import paper_figures
    from sci_lightning.studies.tables.run import find_runs
    from sci_lightning.studies.tables.score_table import encoder_table, run_table, score_table

    out, folders, sensor, most = Path(config["out"]), config["runs"], config["sensor"], config["mosaic"]
    if folders is None:
        raise BadInput("give runs=DIR, a folder of train or of a sweep; documentation=. writes the tables of the pages")
    left_out: list[str] = []

    def leave_out(line: str) -> None:
        left_out.append(line)
        on_left_out(line)

    runs, lines = find_runs([Path(str(folder)) for folder in (folders if isinstance(folders, list) else [folders])])
    for line in lines:
        leave_out(line)
    if config["dashboard"]:
        check_dashboard(out / "tensorboard")
    paper = paper_figures()
    cost = costs(paper["decoders"], decoders)
    grids = [encoder_table(paper["encoders"], encoders)]
    grids += [score_table(name, table, runs, cost) for name, table in paper["tables"].items()]
    grids += [table(paper, runs, cost) for table in (claim_table, verdict_table)]
    recorded = wedges({name: encoders[name] for name in paper["encoders"]}, sensor)
    grids.append(dynamic_range_table(recorded, sensor))
    grids.append(run_table(runs))
    for grid in grids:
        grid.write(out)
    figures = {
        "cost": cost_figure(paper["tables"]["table4"], runs, paper["decoders"]),
        "dynamic_range_map": dynamic_range_figure(recorded),
    }
    networks = [row["match"]["decoder"] for row in paper["tables"]["table3"]["rows"].values()]
    drawn = (
        mosaics(runs, most, leave_out),
        retrained_mosaics(runs, "rbw_sr", networks, most, leave_out),
        colour_checkers(runs, most, leave_out),
    )
    written = {}
    for name, figure in chain(figures.items(), *(drawn if most else ())):
        written[name] = out / f"{name}.png"
        write_figure(figure, written[name])
    if config["dashboard"]:
        write_dashboard(sorted(runs, key=lambda run: str(run.path)), out / "tensorboard")
    return Tables(out, tuple(runs), {grid.name: grid for grid in grids}, written, tuple(left_out))
