"""``python -m sci_lightning.tables.relay``: give the next trainings of the relay a lease of this machine's GPU."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, compose, plain
from sci_lightning.cli.settings import CommandSettings, Place
from sci_lightning.configuration.bounds import ExistingPath, Positive
from sci_lightning.console import PlainConsole


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


def main() -> None:
    """Run the command."""
    run("tables_relay", tables_relay)
