"""The report on snapshots alone: what they tell without a mask, and what a diagnosis still needs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sci_lightning import __version__
from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.diagnosis.blind.snapshot_facts import SnapshotFacts, still_needed
from sci_lightning.files.atomic_file import atomic_write


def write_snapshot_facts(facts: SnapshotFacts, needed: tuple[str, ...], path: str | Path, file: str = "") -> None:
    """Write ``snapshots.json``; the schema ``snapshots`` describes every field.

    Args:
        facts: what the snapshots tell.
        needed: sentences on what a diagnosis still needs.
        path: the file.
        file: name of the file that was read, without its folder.
    """
    content: dict[str, Any] = {
        "format": "sci-snapshots",
        "format_version": 1,
        "file": file,
        **facts.describe(),
        "sentences": list(facts.sentences()),
        "needed": list(needed),
        "sci_lightning": __version__,
    }
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")


def print_snapshot_facts(facts: SnapshotFacts, needed: tuple[str, ...], console: PlainConsole) -> None:
    """Print what the snapshots tell, and what is needed for more."""
    height, width = facts.size
    snapshots = f"{facts.snapshots} snapshot{'s' * (facts.snapshots > 1)}"
    console.say(styled(f"{snapshots} of {height} x {width} pixels, {facts.bit_depth} bits", "bold"))
    for sentence in facts.sentences():
        console.say(f"  {sentence}")
    for sentence in needed:
        console.say(styled("needed for more", "yellow"), f": {sentence}")


def report_snapshots(
    facts: SnapshotFacts, out: str | Path, console: PlainConsole, file: str, has_mask: bool, has_known_scenes: bool
) -> None:
    """Print what the snapshots of a diagnosis tell by themselves, and write ``snapshots.json`` into its folder.

    Args:
        facts: of the snapshots.
        out: the folder.
        console: the terminal.
        file: name of the file that was read, without its folder.
        has_mask: whether the mask is known.
        has_known_scenes: whether there are captures of known scenes beside them.
    """
    needed = still_needed(facts, has_mask, has_known_scenes)
    write_snapshot_facts(facts, needed, Path(out) / "snapshots.json", file)
    print_snapshot_facts(facts, needed, console)
