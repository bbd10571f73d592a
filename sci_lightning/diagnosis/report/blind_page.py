"""``report.html`` of a diagnosis of unknown scenes, whichever way it was made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from sci_lightning import __version__
from sci_lightning.diagnosis.blind.held_out.paired_comparison import PairedComparison
from sci_lightning.diagnosis.report.report_page import Provenance, environment, without_empty_columns

COLUMNS = ("effect", "stage", "parameter", "value", "error (1 σ)", "unit", "snapshots that ask for it", "alternatives")


@dataclass(frozen=True)
class BlindPage:
    """What the page says.

    Attributes:
        verdict: such as ``partly_explained``.
        names: of the named effects.
        headline: the result in one sentence.
        about: the snapshots, in a line.
        notes: what is unusual, in sentences.
        rows: for every parameter a text in every one of :data:`COLUMNS`.
        uncertainty: what the errors mean.
        predicted: prediction errors, a text and a number for every camera.
        figures: pictures by what they show.
        advice: what to record next.
        undetermined: what cannot be told: the name of an effect, and what about the scenes looks like it.
        remark: what else cannot be told.
    """

    verdict: str
    names: Sequence[str]
    headline: str
    about: str
    notes: Sequence[str]
    rows: Sequence[Sequence[str]]
    uncertainty: str
    predicted: Sequence[tuple[str, float]]
    figures: Mapping[str, Figure]
    advice: Sequence[str]
    undetermined: Mapping[str, str]
    remark: str

    def render(self, provenance: Provenance) -> str:
        """Return the page, which needs no other file."""
        template = environment().get_template("blind_page.html")
        table = without_empty_columns(COLUMNS, self.rows)
        return template.render(page=self, table=table, provenance=provenance, version=__version__)


def predicted_errors(
    gap: PairedComparison, without_mask: PairedComparison, verification: PairedComparison | None
) -> list[tuple[str, float]]:
    """Return the prediction errors of three cameras on all snapshots, and of two on those that were set aside.

    Args:
        gap: the ideal camera against the corrected one.
        without_mask: a camera whose mask is the same everywhere against the corrected one.
        verification: ``gap`` on the snapshots that were set aside.
    """
    rows = [("the ideal camera", gap.before), ("the corrected camera", gap.after)]
    rows.append(("a camera without any mask", without_mask.before))
    if verification is not None:
        rows.append(("snapshots set aside, the ideal camera", verification.before))
        rows.append(("snapshots set aside, the corrected camera", verification.after))
    return rows
