"""Every run that was found, also those that belong to none of the paper's tables."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from sci_lightning.studies.tables.grid import Grid
from sci_lightning.studies.tables.line import Line
from sci_lightning.studies.tables.run import Run
from sci_lightning.studies.tables.score_table import SCORES, scores

HEADING = ["encoder", "bits", "decoder", "tested on", SCORES, "parameters", "scale", "seeds"]


def run_table(runs: Sequence[Run]) -> Grid:
    """Return a row for all runs that differ in nothing but the seed; effects stand beside the encoder's name."""
    groups: dict[tuple[str, ...], list[Run]] = defaultdict(list)
    for run in runs:
        named = tuple(str(run.fields[key]) for key in ("encoder", "bits", "decoder", "test_encoder", "mask"))
        alike = (str(run.setting), str(run.setting.conventions), str(run.setting.scenes), str(run.parameters))
        groups[named + alike].append(run)
    rows = []
    for (encoder, bits, decoder, tested, *_), group in sorted(groups.items()):
        line = Line("", "", {}, tuple(group))
        cells = [encoder, bits, decoder, "itself" if tested == encoder else tested, scores(line.mean(), line.spread())]
        rows.append([*cells, f"{group[0].parameters:,}", str(group[0].setting), str(len(group))])
    return Grid("runs", "All runs", HEADING, rows)
