"""``python -m sci_lightning.diagnose``: where do captures and model disagree, and which effect is missing?"""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.console import PlainConsole, styled

if TYPE_CHECKING:
    from sci_lightning.captures import Captures
    from sci_lightning.diagnosis.report.report_page import Provenance
    from sci_lightning.diagnosis.search_settings import SearchSettings
    from sci_lightning.encoder.effects import Effect


def diagnose(composition: Composition) -> None:
    """Write ``report.html``, ``report.json``, ``encoder.yaml`` and pictures, and print what was found.

    Captures of which no scene is known are diagnosed blind.

    Args:
        composition: of ``conf/diagnose.yaml``.
    """
    from sci_lightning.captures import read_captures
    from sci_lightning.cli.next_command import invocation, nearest, print_next
    from sci_lightning.diagnosis.report.report_page import Provenance
    from sci_lightning.diagnosis.search_settings import SearchSettings
    from sci_lightning.diagnosis.vocabulary import vocabulary

    cfg = composition.cfg
    start, out, console = time.perf_counter(), Path(cfg.out), PlainConsole()
    captures = read_captures(cfg.captures)
    candidates = vocabulary(cfg.candidates, composition.targets("effect"), cfg.leave_out)
    settings = SearchSettings(max_effects=cfg.most, **cfg.search)

    def provenance() -> Provenance:
        return Provenance(
            file=Path(cfg.captures).name,
            name=captures.name,
            date=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            runtime_s=time.perf_counter() - start,
            command=shlex.join(["python", "-m", "sci_lightning.diagnose", *sys.argv[1:]]),
        )

    if captures.known.any():
        _calibrated(composition, captures, candidates, settings, console, provenance)
    else:
        _blind(composition, captures, candidates, settings, console, provenance)
    console.say(styled(out / "report.html"), "; beside it report.json, encoder.yaml and pictures")
    lines = [invocation("train", "experiment=quickstart", paths={"encoder": out / "encoder.yaml"})]
    if (truth := Path(cfg.captures).with_suffix(".truth.json")).is_file():
        lines.append(invocation("virtual_camera.reveal", nearest(truth), nearest(out / "report.json")))
    print_next(console, *lines)


def _calibrated(
    composition: Composition,
    captures: Captures,
    candidates: dict[str, type[Effect]],
    settings: SearchSettings,
    console: PlainConsole,
    provenance: Callable[[], Provenance],
) -> None:
    """Diagnose the captures with known scenes, write the report and print it."""
    from sci_lightning.diagnosis import diagnosis as library
    from sci_lightning.diagnosis.report.dashboard import log_diagnosis
    from sci_lightning.diagnosis.report.pictures import figures
    from sci_lightning.diagnosis.report.report import write_report
    from sci_lightning.diagnosis.report.terminal import print_report, search_progress
    from sci_lightning.training.loggers import build_loggers

    cfg = composition.cfg
    with search_progress(console, cfg.most) as on_progress:
        diagnosis = library.diagnose(captures, candidates, cfg.seed, cfg.empirical, settings, on_progress)
        on_progress("writing the report")
        drawn = figures(diagnosis)
        write_report(diagnosis, Path(cfg.out), provenance(), drawn)
    for logger in build_loggers(plain(cfg.logger) if cfg.get("logger") else None, "diagnosis"):
        log_diagnosis(logger, diagnosis, drawn)
    print_report(diagnosis, console)


def _blind(
    composition: Composition,
    captures: Captures,
    candidates: dict[str, type[Effect]],
    settings: SearchSettings,
    console: PlainConsole,
    provenance: Callable[[], Provenance],
) -> None:
    """Diagnose snapshots of unknown scenes, write the report and print it."""
    from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
    from sci_lightning.diagnosis.blind.prior import scene_statistics
    from sci_lightning.diagnosis.report.blind_report import print_blind_report, write_blind_report
    from sci_lightning.diagnosis.report.terminal import search_progress

    cfg = composition.cfg
    console.say("no scene is known: the diagnosis is blind")
    with search_progress(console, cfg.most) as on_progress:
        statistics = scene_statistics(cfg.prior.clips, cfg.prior.file)
        diagnosis = diagnose_blind(captures, candidates, cfg.seed, settings, on_progress, statistics)
        on_progress("writing the report")
        write_blind_report(diagnosis, Path(cfg.out), provenance())
    print_blind_report(diagnosis, console)


if __name__ == "__main__":
    run("diagnose", diagnose)
