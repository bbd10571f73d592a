"""``python -m sci_lightning.diagnose``: where do captures and model disagree, and which effect is missing?"""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.console import PlainConsole, styled

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from sci_lightning.captures import Captures
    from sci_lightning.diagnosis.report.report_page import Provenance
    from sci_lightning.diagnosis.search_settings import SearchSettings
    from sci_lightning.encoder.effects import Effect


@dataclass(frozen=True)
class Task:
    """What is to be diagnosed, and how.

    Attributes:
        cfg: of the command.
        captures: of the camera.
        candidates: effects that may be named, by name.
        settings: thresholds and budgets of the search.
        console: the terminal.
        provenance: says where a report comes from, once it is written.
    """

    cfg: DictConfig
    captures: Captures
    candidates: dict[str, type[Effect]]
    settings: SearchSettings
    console: PlainConsole
    provenance: Callable[[], Provenance]


def diagnose(composition: Composition) -> None:
    """Write ``report.html``, ``report.json``, ``encoder.yaml`` and pictures, and print what was found.

    Captures of which no scene is known are diagnosed blind. Of snapshots without a mask only ``snapshots.json`` is
    written: what they tell by themselves.

    Args:
        composition: of ``conf/diagnose.yaml``.
    """
    from sci_lightning.cli.next_command import invocation, nearest, print_next
    from sci_lightning.diagnosis.report.report_page import Provenance
    from sci_lightning.diagnosis.search_settings import SearchSettings
    from sci_lightning.diagnosis.vocabulary import vocabulary

    cfg = composition.cfg
    start, out, console = time.perf_counter(), Path(cfg.out), PlainConsole()
    captures = read_input(cfg, console)
    if captures is None:
        return
    candidates = vocabulary(cfg.candidates, composition.targets("effect"), cfg.leave_out)
    settings = SearchSettings(max_effects=cfg.most, **cfg.search)

    def provenance() -> Provenance:
        return Provenance(
            file=Path(cfg.captures or cfg.measurement).name,
            name=captures.name,
            date=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            runtime_s=time.perf_counter() - start,
            command=shlex.join(["python", "-m", "sci_lightning.diagnose", *sys.argv[1:]]),
        )

    task = Task(cfg, captures, candidates, settings, console, provenance)
    if captures.known.any():
        _calibrated(task)
    else:
        _blind(task)
    console.say(styled(out / "report.html"), "; beside it report.json, encoder.yaml and pictures")
    lines = [invocation("train", "experiment=quickstart", paths={"encoder": out / "encoder.yaml"})]
    known = bool(captures.known.any())  # a report on unknown scenes has no chi2 to be revealed
    if known and cfg.captures and (truth := Path(cfg.captures).with_suffix(".truth.json")).is_file():
        lines.append(invocation("virtual_camera.reveal", nearest(truth), nearest(out / "report.json")))
    print_next(console, *lines)


def _calibrated(task: Task) -> None:
    """Diagnose the captures with known scenes, write the report and print it."""
    from sci_lightning.diagnosis import diagnosis as library
    from sci_lightning.diagnosis.report.dashboard import log_diagnosis
    from sci_lightning.diagnosis.report.pictures import figures
    from sci_lightning.diagnosis.report.report import write_report
    from sci_lightning.diagnosis.report.terminal import print_report, search_progress
    from sci_lightning.training.loggers import build_loggers

    cfg = task.cfg
    with search_progress(task.console, cfg.most) as on_progress:
        diagnosis = library.diagnose(
            task.captures, task.candidates, cfg.seed, cfg.empirical, task.settings, on_progress
        )
        on_progress("writing the report")
        drawn = figures(diagnosis)
        write_report(diagnosis, Path(cfg.out), task.provenance(), drawn)
    for logger in build_loggers(plain(cfg.logger) if cfg.get("logger") else None, "diagnosis"):
        log_diagnosis(logger, diagnosis, drawn)
    print_report(diagnosis, task.console)


def _blind(task: Task) -> None:
    """Diagnose snapshots of unknown scenes, write the report and print it."""
    from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
    from sci_lightning.diagnosis.blind.prior import scene_statistics
    from sci_lightning.diagnosis.report.blind_report import print_blind_report, write_blind_report
    from sci_lightning.diagnosis.report.terminal import search_progress

    cfg = task.cfg
    task.console.say("no scene is known: the diagnosis is blind")
    with search_progress(task.console, cfg.most) as on_progress:
        statistics = None if cfg.prior is None else scene_statistics(cfg.prior)
        diagnosis = diagnose_blind(task.captures, task.candidates, cfg.seed, task.settings, on_progress, statistics)
        on_progress("writing the report")
        write_blind_report(diagnosis, Path(cfg.out), task.provenance())
    print_blind_report(diagnosis, task.console)


def read_input(cfg: DictConfig, console: PlainConsole) -> Captures | None:
    """Return the captures to diagnose, and report what those of unknown scenes tell by themselves.

    Args:
        cfg: ``captures``, or ``measurement`` with ``mask`` and what belongs to them.
        console: the terminal.

    Returns:
        None where no mask is given, so that there is nothing more to diagnose.

    Raises:
        BadInput: both or neither, or files that cannot be used.
    """
    from sci_lightning.captures import read_captures
    from sci_lightning.captures.snapshots import captures_of_snapshots, matching_files, read_snapshots
    from sci_lightning.diagnosis.blind.snapshot_facts import snapshot_facts
    from sci_lightning.diagnosis.report.snapshot_report import report_snapshots
    from sci_lightning.errors import BadInput

    if (cfg.captures is None) == (cfg.measurement is None):
        raise BadInput(
            "give captures=FILE.h5, or measurement=FILE mask=FILE for snapshots of unknown scenes (one of the two)"
        )
    if cfg.captures is not None:
        captures = read_captures(cfg.captures)
        unknown = ~captures.known
        if unknown.any():
            facts = snapshot_facts(captures.measurement[unknown], captures.bit_depth)
            report_snapshots(facts, cfg.out, console, Path(cfg.captures).name, True, not unknown.all())
        return captures
    dn, bit_depth = read_snapshots(matching_files(cfg.measurement), cfg.key, cfg.bit_depth)
    facts = snapshot_facts(dn, bit_depth)
    name = Path(cfg.measurement).name
    if cfg.mask is None:
        report_snapshots(facts, cfg.out, console, name, False, False)
        console.say(styled(Path(cfg.out) / "snapshots.json"))
        return None
    captures = captures_of_snapshots(
        dn,
        bit_depth,
        cfg.mask,
        key=cfg.mask_key,
        step=cfg.mask_step,
        origin=cfg.mask_origin,
        verification=cfg.verification,
        name=Path(cfg.measurement).parent.resolve().name,
    )
    report_snapshots(facts, cfg.out, console, name, True, False)
    return captures


if __name__ == "__main__":
    run("diagnose", diagnose)
