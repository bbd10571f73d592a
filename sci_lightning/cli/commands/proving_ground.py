"""``python -m sci_lightning.proving_ground``: how often is a diagnosis right?"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.settings import BitDepth, Name, StudySettings
from sci_lightning.configuration.bounds import Frames, Repeats, Seed, Size
from sci_lightning.console import PlainConsole, styled

if TYPE_CHECKING:  # --help answers without torch
    from sci_lightning.studies.engine import Records
    from sci_lightning.studies.proving_ground.case import Case
    from sci_lightning.studies.proving_ground.outcome import Outcome

PLANNED = (
    "suites",
    "seeds",
    "first_round",
    "cases",
    "effects",
    "size",
    "slots",
    "masks",
    "bit_depths",
    "datasheets",
    "formulations",
)
"""Keys of the configuration that :func:`~.plan.plan` takes."""
PLACES = ("out", "workers", "threads", "job", "run", "debug")
"""Keys that say where and how cases are run, not which ones."""


@dataclass(frozen=True)
class ProvingGroundSettings(StudySettings):
    suites: Sequence[Name]
    seeds: Repeats
    first_round: Seed
    cases: Repeats | None
    effects: Any
    size: Size
    slots: Sequence[Frames]
    masks: Sequence[Name]
    bit_depths: Sequence[BitDepth]
    datasheets: Sequence[Name]
    formulations: Sequence[Name]
    run: bool


def proving_ground(composition: Composition) -> None:
    """Run the cases that have no record yet, then write and print the summary of all records in ``out``."""
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.errors import BadInput
    from sci_lightning.studies.engine import FailedCase, Records
    from sci_lightning.studies.proving_ground.outcome import Outcome
    from sci_lightning.studies.proving_ground.pictures import write_pictures
    from sci_lightning.studies.proving_ground.plan import plan
    from sci_lightning.studies.proving_ground.report import provenance_of, write_report
    from sci_lightning.studies.proving_ground.summary import summarise

    cfg = composition.cfg
    settings, out, console = plain(cfg), Path(cfg.out), PlainConsole()
    files = Records(out / "cases", Outcome)
    if cfg.run:
        cases = plan(**{key: settings[key] for key in PLANNED})
        run_missing(cases, files, {key: settings[key] for key in ("workers", "threads", "job")}, console)
        if left := sum(files.ended(case) is None for case in cases):
            console.print(f"{left} of {len(cases)} cases are run by other processes, the last of which sums up")
            return
    records: list[Outcome | FailedCase] = [*files.read(), *files.failures()]
    if not records:
        raise BadInput(f"{files.folder}: no records to sum up; run=true makes some, out= says where they are")
    rows = summarise(records)
    chosen = [override for override in composition.overrides if override.split("=")[0].lstrip("+") not in PLACES]
    command = shlex.join(("python", "-m", "sci_lightning.proving_ground", *chosen)) if cfg.run else ""
    write_report(out, rows, provenance_of(records, command))
    pictures = write_pictures(out, records)
    marks = {True: styled("yes", "green"), False: styled("no ", "red"), None: styled("   ", "")}
    for row in rows:
        console.say(marks[row.met], f" {row.what}: {row.figure}" + (f" (target {row.target})" if row.target else ""))
    console.say(styled(out), f": summary.md, summary.json, {', '.join(path.name for path in pictures)}")
    same = [
        f"{key}={settings[key]}".replace(" ", "").replace("'", "") for key in PLANNED if key not in ("seeds", "effects")
    ]
    overrides = [override.replace("None", "null") for override in (*same, f"seeds={cfg.seeds + 1}")]
    print_next(console, invocation("proving_ground", *overrides, paths={"out": out}))


def run_missing(cases: list[Case], files: Records[Outcome], where: Mapping[str, Any], console: PlainConsole) -> None:
    """Run the cases that have no record yet, and print what each came to."""
    from sci_lightning.studies.engine import FailedCase, run_cases
    from sci_lightning.studies.proving_ground.plan import in_turns
    from sci_lightning.studies.proving_ground.trial import run_trial

    missing = files.missing(in_turns(cases), where["job"])
    console.print(f"{len(missing)} cases to try, {len(cases) - len(missing)} done before: {files.folder}")
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn())
    with Progress(*columns, console=console, speed_estimate_period=600) as progress:
        task = progress.add_task("", total=len(missing))
        for outcome in run_cases(run_trial, missing, files, **where):
            progress.advance(task)
            if isinstance(outcome, FailedCase):
                console.say(styled("failed", "red"), f" {outcome}")
            else:
                console.say(styled("right", "green") if outcome.right else styled("wrong", "red"), f"  {outcome}")
