"""The report on snapshots alone: what they tell without a mask, and what a diagnosis still needs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sci_lightning.console import PlainConsole, styled
from sci_lightning.diagnosis.blind.snapshot_facts import SnapshotFacts, still_needed
from sci_lightning.files.json_file import write_json
from sci_lightning.runs.provenance import installed_version


@dataclass(frozen=True)
class SnapshotReport:
    """What snapshots tell by themselves, to be printed and kept.

    Attributes:
        facts: of the snapshots.
        file: name of the file that was read, without its folder.
        has_mask: whether the mask is known.
        has_known_scenes: whether there are captures of known scenes beside them.
    """

    facts: SnapshotFacts
    file: str
    has_mask: bool
    has_known_scenes: bool

    @property
    def needed(self) -> tuple[str, ...]:
        """Sentences on what a diagnosis still needs."""
        return still_needed(self.facts, self.has_mask, self.has_known_scenes)

    def print(self, console: PlainConsole) -> None:
        """Print what the snapshots tell, and what is needed for more."""
        height, width = self.facts.size
        snapshots = f"{self.facts.snapshots} snapshot{'s' * (self.facts.snapshots > 1)}"
        console.say(styled(f"{snapshots} of {height} x {width} pixels, {self.facts.bit_depth} bits", "bold"))
        for sentence in self.facts.sentences():
            console.say(f"  {sentence}")
        for sentence in self.needed:
            console.say(styled("needed for more", "yellow"), f": {sentence}")

    def write(self, path: str | Path) -> None:
        """Write ``snapshots.json``, see :class:`sci_lightning.files.diagnosis_report.SnapshotFacts`."""
        content = {
            "format": "sci-snapshots",
            "format_version": 1,
            "file": self.file,
            **self.facts.describe(),
            "sentences": list(self.facts.sentences()),
            "needed": list(self.needed),
            "sci_lightning": installed_version(),
        }
        write_json(content, path)
