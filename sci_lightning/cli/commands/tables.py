"""``python -m sci_lightning.tables``: the paper's tables, with what our runs found beside each of its figures."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from omegaconf import OmegaConf

from sci_lightning.cli.composition import Composition, compose, group_members, plain
from sci_lightning.cli.settings import CommandSettings, Count, Place
from sci_lightning.configuration.bounds import ExistingPath, Positive
from sci_lightning.console import PlainConsole, styled
from sci_lightning.plain_text import one_printable_line

if TYPE_CHECKING:
    from sci_lightning.studies.tables.paper_tables import Tables


@dataclass(frozen=True)
class TablesSettings(CommandSettings):
    runs: ExistingPath | Sequence[ExistingPath] | None
    documentation: Place | None
    mosaic: Count
    dashboard: bool
    sensor: Mapping[str, Positive | None]


def tables(composition: Composition) -> None:
    """Write the tables and figures of the runs below ``runs``, and print the tables.

    Files that are of no use are named, one line each, and the others go on.

    With ``documentation=DIR`` it writes the measured tables of README.md and docs/ from docs/results/ instead.
    """
    if composition.cfg.documentation:
        _write_documentation(Path(str(composition.cfg.documentation)))
        return
    from sci_lightning.cli.next_command import browser, dashboard, invocation, print_next

    console = PlainConsole()
    made = tables_of(composition, _left_out)
    for grid in made.grids.values():
        console.print(grid.as_table(console.width))
    console.say(styled(made.folder), f": {', '.join(made.grids)} as .md, .tex and .png; {len(made.runs)} runs")
    console.print(f"figures: {', '.join(made.figures)} as .png")
    shown = [dashboard(made.folder / "tensorboard")] if composition.cfg.dashboard else []
    more = invocation("train", "-m", "experiment=table5", "scale=cpu")
    print_next(console, *shown, browser(made.figures["cost"]), more)


def tables_of(composition: Composition, on_left_out: Callable[[str], None] = lambda line: None) -> Tables:
    """Make the tables that ``conf/tables.yaml`` asks for, beside the package's own decoders and encoders."""
    from sci_lightning.studies.tables.paper_figures import paper_figures
    from sci_lightning.studies.tables.paper_tables import make_tables

    counted = [name for name in group_members("decoder") if name in paper_figures()["decoders"]]
    words = [
        f"+{group}@members.{group}.{name}={name}"  # one composition that holds all of them
        for group, names in (("decoder", counted), ("encoder", group_members("encoder")))
        for name in names
    ]
    members = compose("train", ["frames=8", "size=[32,32]", *words]).cfg.members
    # of encoders whose mask is a file, the file is missing
    decoders, encoders = (OmegaConf.to_container(members[group], resolve=True) for group in ("decoder", "encoder"))
    return make_tables(plain(composition.cfg), cast(Any, decoders), cast(Any, encoders), on_left_out)


def _write_documentation(root: Path) -> None:
    """Write the measured tables of the pages anew, and say which pages changed."""
    from sci_lightning.studies.tables.documentation import update_pages

    changed, console = update_pages(root), PlainConsole()
    for page in changed:
        console.say(styled(page), ": tables written")
    if not changed:
        console.print("every table of the documentation is as its file says")


def _left_out(line: str) -> None:
    print(f"left out: {one_printable_line(line)}", file=sys.stderr)


@dataclass(frozen=True)
class TablesRelaySettings(CommandSettings):
    """Types and ranges of ``conf/tables_relay.yaml``, which states the defaults and what they mean."""

    seconds: Positive
    reserve: Positive
    queue: ExistingPath
    footage: ExistingPath
    archive: Place | None
    take: ExistingPath | None


def tables_relay(composition: Composition) -> None:
    """Train what is next for so many seconds, and write the weights, the scores and what was done.

    Args:
        composition: of ``conf/tables_relay.yaml``.

    Raises:
        BadInput: settings of no use, or a recipe that cannot be composed.
        MachineFailure: trainings failed; the others got their lease.
    """
    from sci_lightning.cli.next_command import override
    from sci_lightning.studies.relay.relay import Relay

    cfg, console = composition.cfg, PlainConsole()

    def say(line: str) -> None:
        console.print(f"{datetime.now():%H:%M:%S} {line}", soft_wrap=True)
        sys.stdout.flush()

    archive = Path(cfg.archive) if cfg.archive else None
    footage = Path(cfg.footage).resolve()
    relay = Relay(Path(cfg.queue), Path(cfg.out).resolve(), cfg.seconds, cfg.reserve, footage, override, say, archive)
    if cfg.take:
        relay.take(Path(cfg.take))
        say(f"took over what {cfg.take} holds")
        return
    for training in relay.queue.following(set()):  # refused before anything is written
        if training.command == "train":
            plain(compose("train", relay.recipe(training)).cfg)
    relay.run()
