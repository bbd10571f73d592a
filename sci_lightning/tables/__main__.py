"""``python -m sci_lightning.tables``: the paper's tables, with what our runs found beside each of its figures."""

from __future__ import annotations

import sys
from itertools import chain
from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, compose, group_members, plain
from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.configuration.conf_folder import PACKAGE
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import one_printable_line


def tables(composition: Composition) -> None:
    """Collect the ``metrics.json`` below ``runs``; print each table and write it as Markdown, LaTeX and PNG.

    Beside them the paper's figures as PNG: quality against cost, dynamic range, mosaics of runs that left a checkpoint.
    With ``dashboard=true`` a TensorBoard log as well, in which every run is a trial.
    Files that are of no use are named, one line each, and the others go on.

    With ``documentation=DIR`` it writes the measured tables of README.md and docs/ from docs/results/ instead.

    Args:
        composition: of ``conf/tables.yaml``.
    """
    if composition.cfg.documentation:
        _write_documentation(Path(str(composition.cfg.documentation)))
        return
    from sci_lightning.cli.next_command import browser, dashboard, invocation, print_next
    from sci_lightning.imaging.figures import write_figure
    from sci_lightning.tables.claim_table import claim_table, verdict_table
    from sci_lightning.tables.colour_checker import colour_checkers
    from sci_lightning.tables.cost import costs
    from sci_lightning.tables.cost_figure import cost_figure
    from sci_lightning.tables.dashboard import check_dashboard, write_dashboard
    from sci_lightning.tables.dynamic_range import dynamic_range_figure, dynamic_range_table, wedges
    from sci_lightning.tables.encoder_table import encoder_table
    from sci_lightning.tables.mosaic import mosaics, retrained_mosaics
    from sci_lightning.tables.run import find_runs
    from sci_lightning.tables.run_table import run_table
    from sci_lightning.tables.score_table import score_table

    cfg = composition.cfg
    out, console = Path(cfg.out), PlainConsole()
    folders = plain(cfg)["runs"]
    if folders is None:
        raise BadInput("give runs=DIR, a folder of train or of a sweep; documentation=. writes the tables of the pages")
    runs, lines = find_runs([Path(str(folder)) for folder in (folders if isinstance(folders, list) else [folders])])
    for line in lines:
        _left_out(line)
    if cfg.dashboard:
        check_dashboard(out / "tensorboard")
    paper = yaml.safe_load((PACKAGE / "tables" / "paper_figures.yaml").read_text())
    ours = [name for name in group_members("decoder") if name in paper["decoders"]]
    cost = costs(paper["decoders"], _members("decoder", ours, "frames=8"))
    encoders = _members("encoder", group_members("encoder"), "frames=8", "size=[32,32]")
    grids = [encoder_table(paper["encoders"], encoders)]
    grids += [score_table(name, table, runs, cost) for name, table in paper["tables"].items()]
    grids += [table(paper["claims"], paper["tables"], runs, cost) for table in (claim_table, verdict_table)]
    recorded = wedges({name: encoders[name] for name in paper["encoders"]}, cfg.sensor)
    grids.append(dynamic_range_table(recorded, cfg.sensor))
    grids.append(run_table(runs))
    for grid in grids:
        grid.write(out)
        console.print(grid.as_table(console.width))
    figures = {
        "cost": cost_figure(paper["tables"]["table4"], runs, paper["decoders"]),
        "dynamic_range_map": dynamic_range_figure(recorded),
    }
    networks = [row["match"]["decoder"] for row in paper["tables"]["table3"]["rows"].values()]
    drawn = (
        mosaics(runs, cfg.mosaic, _left_out),
        retrained_mosaics(runs, "rbw_sr", networks, cfg.mosaic, _left_out),
        colour_checkers(runs, cfg.mosaic, _left_out),
    )
    names = []
    for name, figure in chain(figures.items(), *(drawn if cfg.mosaic else ())):
        write_figure(figure, out / f"{name}.png")
        names.append(name)
    console.say(styled(out), f": {', '.join(grid.name for grid in grids)} as .md, .tex and .png; {len(runs)} runs")
    console.print(f"figures: {', '.join(names)} as .png")
    shown = []
    if cfg.dashboard:
        write_dashboard(sorted(runs, key=lambda run: str(run.path)), out / "tensorboard")
        shown.append(dashboard(out / "tensorboard"))
    print_next(console, *shown, browser(out / "cost.png"), invocation("train", "-m", "experiment=table5", "scale=cpu"))


def _write_documentation(root: Path) -> None:
    """Write the measured tables of the pages anew, and say which pages changed."""
    from sci_lightning.tables.documentation import update_pages

    changed, console = update_pages(root), PlainConsole()
    for page in changed:
        console.say(styled(page), ": tables written")
    if not changed:
        console.print("every table of the documentation is as its file says")


def _members(group: str, names: list[str], *overrides: str) -> dict[str, Any]:
    """Return the plain configurations of members of a group, as ``train`` would have them, by their names."""
    composed = {name: compose("train", [f"{group}={name}", *overrides]).cfg[group] for name in names}
    # of encoders whose mask is a file, the file is missing
    return {name: OmegaConf.to_container(member, resolve=True) for name, member in composed.items()}


def _left_out(line: str) -> None:
    print(f"left out: {one_printable_line(line)}", file=sys.stderr)


if __name__ == "__main__":
    run("tables", tables)
