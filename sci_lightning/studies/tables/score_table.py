"""The tables out of runs: Table 1, Tables 2 to 5 with our scores beside the paper's, and a table of all runs."""

from __future__ import annotations

import math
import re
import statistics
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from sci_lightning.studies.tables.cost import Cost
from sci_lightning.studies.tables.grid import Grid
from sci_lightning.studies.tables.line import METRICS, Line, lines_of
from sci_lightning.studies.tables.run import ScoredRun

SCORES = "PSNR (dB), SSIM, Q-Score"
HEADING = ["row", "column", f"ours: {SCORES}", "the paper's", "difference", "scale", "seeds"]
COST = ["parameters (M)", "FLOPs (G)", "time (s)"]
COST_NOTE = (
    "Parameters and FLOPs are those of the full network at 256 x 256, T = 8, counted as the paper counts; the time is "
    "of one measurement at the row's own scale. In brackets the paper's, whose time is of a GPU."
)
MASK_SCORE = "score of the mask (dB)"
MASK_NOTE = (
    "The score of a mask is the PSNR that the best linear decoder is expected to reach behind it, in closed form."
)
STEPS = "training steps"
STEPS_NOTE = (
    "Training steps: of the seeds that recorded them, the least to the most. Where trainings end after so many "
    "minutes, a faster processor makes more steps in them; rows of one network are as comparable as their steps."
)
NOTE = "Difference: ours less the paper's. Behind ±: the standard deviation over the seeds."
DIGITS = {"psnr": 2, "ssim": 3, "qscore": 2}

Scores = Mapping[str, float]


def encoder_table(paper: Mapping[str, Mapping[str, str]], encoders: Mapping[str, Mapping[str, Any]]) -> Grid:
    """Return a row for each encoder, the paper's first and in its order.

    Args:
        paper: ``encoders`` of ``paper_figures.yaml``.
        encoders: plain configurations of ours by name.
    """
    others = [name for name in encoders if name not in paper]
    rows = [_encoder_row(name, encoders[name], paper.get(name, {})) for name in (*paper, *others)]
    heading = ["encoder", "mask", "sensor", "aperture", "in the paper", "the paper's definition"]
    return Grid("table1", "Table 1: definition of the encoders", heading, rows)


def _encoder_row(name: str, encoder: Mapping[str, Any], paper: Mapping[str, str]) -> list[str]:
    mask, sensor = (_words(encoder[part]) for part in ("mask", "sensor"))
    return [name, mask, sensor, str(encoder["aperture"]), paper.get("row", ""), paper.get("configuration", "")]


def _words(part: Mapping[str, Any]) -> str:
    """The class of a mask or a sensor in words, with its bits."""
    kind = str(part["_target_"]).rpartition(".")[2]
    words = re.sub(r"(?<!^)(?=[A-Z])", " ", kind).lower()
    bits = part.get("bits") or part.get("bit_depth")
    return f"{words}, {bits} bits" if bits else words


def score_table(
    name: str, table: Mapping[str, Any], runs: Sequence[ScoredRun], costs: Mapping[str, Cost] | None = None
) -> Grid:
    """One of the paper's tables with our runs in it; what has not been run is empty.

    Args:
        name: of the files.
        table: of ``paper_figures.yaml``.
        runs: any; those that belong to the table are found by their fields.
        costs: of decoders, ours and the paper's, for a table with ``cost``.
    """
    lines = lines_of(table, runs)
    columns = list(table["columns"])
    first, last = columns[0], columns[-1]
    scored = any(run.mask_score is not None for line in lines for run in line.runs) and bool(table.get("mask_score"))
    counted = any(run.training_steps is not None for line in lines for run in line.runs)
    rows = []
    for line in lines:
        cells = [line.row, line.column, *_cells(line.mean(), line.spread(), line.paper), *_origin(line.runs)]
        if table.get("cost"):
            cells += _cost(line, (costs or {}).get(line.decoder)) if line.column == last else [""] * len(COST)
        if scored:
            values = [run.mask_score for run in line.runs if run.mask_score is not None]
            cells.append(f"{statistics.fmean(values):.2f}" if values else "")
        cells += [_steps(line.runs)] * counted
        rows.append(cells)
        gain = str(table.get("gain"))
        if line.column == last and gain in table["rows"][line.row]:
            paper = dict(zip(METRICS, table["rows"][line.row][gain], strict=True))
            cells = [line.row, gain, *_gain(line, [other for other in lines if other.column == first], paper)]
            rows.append(cells)
    devices = sorted({run.device for line in lines for run in line.runs})
    notes = [f"Runs on {', '.join(devices)}."] if devices else []
    sentences = {f"{key}: {text}." for line in lines for run in line.runs for key, text in run.setting.conventions}
    notes += [*sorted(sentences), NOTE]
    heading = [
        *table.get("titles", HEADING[:2]),
        *HEADING[2:],
        *(COST if table.get("cost") else []),
        *([MASK_SCORE] if scored else []),
        *([STEPS] if counted else []),
    ]
    notes += [COST_NOTE] * bool(table.get("cost")) + [MASK_NOTE] * scored + [STEPS_NOTE] * counted
    rows = [row + [""] * (len(heading) - len(row)) for row in rows]  # gains have the columns of scores alone
    return Grid(name, table["title"], heading, rows, notes)


def run_table(runs: Sequence[ScoredRun]) -> Grid:
    """Return a row for all runs that differ in nothing but the seed; effects stand beside the encoder's name.

    Those that belong to none of the paper's tables are among them.
    """
    heading = ["encoder", "bits", "decoder", "tested on", SCORES, "parameters", "scale", "seeds"]
    groups: dict[tuple[str, ...], list[ScoredRun]] = defaultdict(list)
    for run in runs:
        named = tuple(str(run.fields[key]) for key in ("encoder", "bits", "decoder", "test_encoder", "mask"))
        alike = (str(run.setting), str(run.setting.conventions), str(run.setting.scenes), str(run.parameters))
        groups[named + alike].append(run)
    rows = []
    for (encoder, bits, decoder, tested, *_), group in sorted(groups.items()):
        line = Line("", "", {}, tuple(group))
        cells = [encoder, bits, decoder, "itself" if tested == encoder else tested, scores(line.mean(), line.spread())]
        rows.append([*cells, f"{group[0].parameters:,}", str(group[0].setting), str(len(group))])
    return Grid("runs", "All runs", heading, rows)


def scores(mean: Scores, spread: Scores | None = None, sign: str = "") -> str:
    """Scores as one text in the paper's order, a dash for a metric that is missing among others."""
    if not mean:
        return ""
    return ", ".join(_number(key, mean, spread or {}, sign) for key in METRICS)


def less(one: Scores, other: Scores) -> dict[str, float]:
    """The difference of what both have."""
    return {key: one[key] - other[key] for key in one if key in other}


def together(one: Scores, other: Scores) -> dict[str, float]:
    """The spread of a difference of two that are independent."""
    return {key: math.hypot(one[key], other[key]) for key in one if key in other}


def partner(line: Line, lines: Sequence[Line]) -> Line | None:
    """The line with the same setting and size of network, which ``line`` can be compared with."""
    return next((other for other in lines if other.runs and other.group == line.group), None)


def seeds(*groups: Sequence[ScoredRun]) -> str:
    """How many seeds, of each group when they differ."""
    return " / ".join(dict.fromkeys(str(len(group)) for group in groups))


def _gain(line: Line, others: Sequence[Line], paper: Scores) -> list[str]:
    """The cells of what the line gains over its partner in the same row."""
    other = partner(line, [other for other in others if other.row == line.row]) if line.runs else None
    if other is None:
        return [*_cells({}, {}, paper, "+"), "", ""]
    cells = _cells(less(line.mean(), other.mean()), together(line.spread(), other.spread()), paper, "+")
    return [*cells, str(line.runs[0].setting), seeds(line.runs, other.runs)]


def _cells(mean: Scores, spread: Scores, paper: Scores, sign: str = "") -> list[str]:
    return [scores(mean, spread, sign), scores(paper, sign=sign), scores(less(mean, paper), sign="+")]


def _origin(runs: Sequence[ScoredRun]) -> list[str]:
    return [str(runs[0].setting), seeds(runs)] if runs else ["", ""]


def _steps(runs: Sequence[ScoredRun]) -> str:
    """The training steps of the runs that recorded them, and of how many these are where some did not."""
    steps = [run.training_steps for run in runs if run.training_steps is not None]
    if not steps:
        return ""
    span = " to ".join(f"{count:,}" for count in sorted({min(steps), max(steps)}))
    return span if len(steps) == len(runs) else f"{span} ({len(steps)} of {len(runs)} seeds)"


def _cost(line: Line, cost: Cost | None) -> list[str]:
    if cost is None:
        return [""] * len(COST)
    seconds = f"{statistics.fmean(run.seconds for run in line.runs):.3g}" if line.runs else ""
    counted = [] if cost.parameters is None else [f"{cost.parameters / 1e6:.2f}", f"{(cost.macs or 0) / 1e9:.2f}"]
    ours = [*(counted or ["", ""]), seconds]
    paper = [f"{cost.paper[key]:.2f}" for key in ("parameters_M", "macs_G", "seconds")]
    return [f"{one} ({other})".strip() for one, other in zip(ours, paper, strict=True)]


def _number(key: str, mean: Scores, spread: Scores, sign: str) -> str:
    if key not in mean:
        return "-"
    digits = DIGITS[key]
    return f"{mean[key]:{sign}.{digits}f}" + (f" ± {spread[key]:.{digits}f}" if key in spread else "")
