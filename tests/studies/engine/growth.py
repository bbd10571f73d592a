"""``python -m tests.studies.engine.growth JSON``: what a study costs that computes nothing, for 100 to 10,000 cases.

Of every number of cases: processor time to run them one after the other, to find that all have ended, and to read their
records; files, bytes and memory; then the same of cases in processes of their own and of four jobs that share a folder,
and of the rows of the paper's tables.
"""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sci_lightning.cli.composition import compose, plain
from sci_lightning.studies.engine import run_cases
from sci_lightning.studies.tables.paper_figures import paper_figures
from sci_lightning.studies.tables.rows import check_recipe, is_kept, kept_files, plan
from sci_lightning.studies.tables.run import find_runs
from tests.measurements_file import ROOT, Column, MeasurementsFile
from tests.studies.engine.numbers import Number, records, square

COUNTS = (100, 1000, 10_000)
COLUMNS: list[Column] = [
    ("what", "processor time, files and bytes of a case", None),
    ("count", "cases", 0),
    ("run", "run (ms)", 2),
    ("resume", "find that it has ended (ms)", 2),
    ("collect", "read its record (ms)", 2),
    ("files", "files", 2),
    ("bytes", "bytes", 0),
    ("memory", "memory of the command (MiB)", 0),
]


def processor_seconds() -> float:
    """Return the time of a processor that this process and those that it has started and that have ended took."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def milliseconds(action: Callable[[], Any], count: int) -> float:
    """Return how long an action takes of a processor, in ms, over ``count``; other work beside it does not count."""
    start = processor_seconds()
    action()
    return 1000 * (processor_seconds() - start) / count


def measured(folder: Path, what: str, count: int, run: Callable[[list[Number]], object]) -> dict[str, Any]:
    """Return a row: ``run`` runs the cases that it is given and leaves their records in the folder."""
    cases, kept = [Number(1000 + number) for number in range(count)], records(folder)
    row = {"what": what, "count": count, "run": milliseconds(lambda: run(cases), count)}
    left: list[Any] = []
    row["resume"] = milliseconds(lambda: left.extend(kept.missing(cases)), count)
    row["collect"] = milliseconds(kept.read, count)
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert not left and len(kept.read()) == count
    row |= {"files": len(files) / count, "bytes": sum(path.stat().st_size for path in files) / count}
    return row | {"memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


JOB = """
import sys
from pathlib import Path
from sci_lightning.studies.engine import run_cases
from tests.studies.engine.numbers import Number, records, square
kept, cases = records(Path(sys.argv[1])), [Number(1000 + number) for number in range(int(sys.argv[2]))]
list(run_cases(square, kept.missing(cases, job := int(sys.argv[3])), kept, job=job))
"""


def jobs(folder: Path, count: int) -> None:
    """Run the cases by four processes that share the folder."""
    words = [sys.executable, "-c", JOB, str(folder), str(count)]
    started = [subprocess.Popen([*words, str(job)], cwd=ROOT) for job in range(4)]
    assert not any(process.wait() for process in started)


def rows_of_tables(folder: Path) -> dict[str, Any]:
    """Return a row for the paper's tables: a thousand rows that were trained, and copies of what is kept of them."""
    rows = [row for row in plan(paper_figures()["tables"], 50, (), 33) if not row.tests][:1000]
    content = json.loads(
        next((ROOT / "docs/results/tables/cpu_4000_steps").glob("rsw_sr_1bit*/seed0.json")).read_text()
    )
    for row in rows:
        (path,) = kept_files(row, folder)
        path.parent.mkdir(parents=True, exist_ok=True)
        encoder = {**content, "encoder": row.encoder, "decoder": row.decoder, "test_encoder": row.encoder}
        path.write_text(json.dumps(encoder | {"config": {**content["config"], "seed": row.seed}}))
    config = plain(compose("train", [*rows[0].overrides(), "scale=cpu"]).cfg)
    config |= {key: content["config"][key] for key in content["config"]}

    def resume() -> None:
        for row in rows:
            assert is_kept(row, folder)
            check_recipe(row, folder, config)

    size = sum(path.stat().st_size for path in folder.rglob("*.json")) / len(rows)
    return {
        "what": "rows of the tables, kept",
        "count": len(rows),
        "resume": milliseconds(resume, len(rows)),
        "collect": milliseconds(lambda: find_runs([folder]), len(rows)),
        "files": 1.0,
        "bytes": size,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def main(out: Path) -> None:
    """Measure and write the table."""
    file = MeasurementsFile(
        out,
        machine="one core",
        scale="cases that compute nothing, a folder on the machine's own disk",
        seeds="none",
        command="python -m tests.studies.engine.growth docs/results/growth.json",
    )
    place = Path(tempfile.mkdtemp())
    rows = []
    try:
        for count in COUNTS:
            folder = place / str(count)
            rows.append(
                measured(
                    folder,
                    "in one process",
                    count,
                    lambda cases, at=folder: [None for _ in run_cases(square, cases, records(at))],
                )
            )
        start = milliseconds(lambda: subprocess.run([sys.executable, "-c", "import torch"], check=True), 1)
        own = measured(
            place / "own",
            "a process each",
            30,
            lambda cases: list(run_cases(square, cases, records(place / "own"), workers=1)),
        )
        rows.append(own | {"what": f"a process each, of which {start:.0f} ms import torch"})
        rows.append(measured(place / "jobs", "four jobs on one folder", 1000, lambda cases: jobs(place / "jobs", 1000)))
        rows.append(rows_of_tables(place / "rows"))
    finally:
        shutil.rmtree(place)
    for row in rows:
        print(row)
    file.write(COLUMNS, rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
