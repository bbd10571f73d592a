"""``python -m sci_lightning.proving_ground``: how often is a diagnosis right?"""

from __future__ import annotations

from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.proving_ground.case import Case
from sci_lightning.proving_ground.records import Records


def proving_ground(composition: Composition) -> None:
    """Try the cases that have no record yet, then write and print the summary of all records in ``out``.

    Args:
        composition: of ``conf/proving_ground.yaml``.
    """
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.errors import BadInput
    from sci_lightning.proving_ground.pictures import write_pictures
    from sci_lightning.proving_ground.plan import plan
    from sci_lightning.proving_ground.report import write_report
    from sci_lightning.proving_ground.summary import sum_up

    cfg = composition.cfg
    given, out, console = plain(cfg), Path(cfg.out), PlainConsole()
    records = Records(out / "cases")
    if cfg.run:
        names = ("suites", "seeds", "effects", "size", "frames", "masks", "bit_depths")
        cases = plan(**{name: given[name] for name in names}, most=given["cases"])
        attempt_all(cases, records, cfg.workers, cfg.threads, console)
    found = records.read()
    if not found:
        raise BadInput(f"{records.folder}: no records to sum up; run=true makes some, out= says where they are")
    rows = sum_up(found)
    write_report(out, rows)
    pictures = write_pictures(out, found)
    for row in rows:
        marks = {True: styled("yes", "green"), False: styled("no ", "red"), None: styled("   ", "")}
        console.say(marks[row.met], f" {row.what}: {row.found}" + (f" (target {row.target})" if row.target else ""))
    console.say(styled(out), f": summary.md, summary.json, {', '.join(path.name for path in pictures)}")
    words = [f"{name}={plain(cfg)[name]}".replace(" ", "").replace("'", "") for name in ("suites", "size", "cases")]
    more = [word.replace("None", "null") for word in (*words, f"seeds={cfg.seeds + 1}")]
    print_next(console, invocation("proving_ground", *more, paths={"out": out}))


def attempt_all(cases: list[Case], records: Records, workers: int, threads: int, console: PlainConsole) -> None:
    """Try the cases that ``records`` has not, and keep each record as soon as it is there."""
    from sci_lightning.proving_ground.crew import work_through
    from sci_lightning.proving_ground.outcome import Outcome

    waiting = [case for case in cases if not records.has(case)]
    console.print(f"{len(waiting)} cases to try, {len(cases) - len(waiting)} done before: {records.folder}")
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn())
    with Progress(*columns, console=console, speed_estimate_period=600) as progress:
        bar = progress.add_task("", total=len(waiting))
        for record in work_through(waiting, workers, threads):
            records.write(record)
            progress.advance(bar)
            if "failed" in record:
                console.say(styled("failed", "red"), f" {record['case']}: {record['failed']}")
            else:
                outcome = Outcome(record)
                console.say(styled("right", "green") if outcome.right else styled("wrong", "red"), f"  {outcome}")


if __name__ == "__main__":
    run("proving_ground", proving_ground)
