"""``python -m sci_lightning.diagnose``: where do captures and model disagree, and which effect is missing?"""

from __future__ import annotations

import shlex
import sys
import time
from datetime import datetime, timezone
from pathlib import Path

from omegaconf import DictConfig

from sci_lightning.cli.command import run, targets
from sci_lightning.cli.console import PlainConsole, styled


def diagnose(cfg: DictConfig) -> None:
    """Write ``report.html``, ``report.json``, ``encoder.yaml`` and pictures, and print what was found.

    Args:
        cfg: ``conf/diagnose.yaml``, composed.
    """
    from sci_lightning.captures import read_captures
    from sci_lightning.cli.loggers import chosen_loggers
    from sci_lightning.cli.next_command import invocation, nearest, print_next
    from sci_lightning.diagnosis.diagnosis import diagnose
    from sci_lightning.diagnosis.report.dashboard import log
    from sci_lightning.diagnosis.report.pictures import figures
    from sci_lightning.diagnosis.report.report import describe, write_encoder, write_page, write_pictures
    from sci_lightning.diagnosis.report.sentences import headline
    from sci_lightning.diagnosis.report.terminal import print_report, searching
    from sci_lightning.diagnosis.search_settings import SearchSettings
    from sci_lightning.diagnosis.vocabulary import vocabulary
    from sci_lightning.runs.results import write_json

    start, out, console = time.perf_counter(), Path(cfg.out), PlainConsole()
    captures = read_captures(cfg.captures)
    candidates = vocabulary(cfg.candidates, targets("effect"))
    with searching(console, cfg.most) as told:
        settings = SearchSettings(max_effects=cfg.most, **cfg.search)
        found = diagnose(captures, candidates, cfg.seed, cfg.empirical, settings, told)
        told("writing the report")
        drawn = figures(found)
        report = describe(found) | {
            "captures": {"file": Path(cfg.captures).name, "name": captures.name},
            "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
            "runtime_s": time.perf_counter() - start,
        }
        sentence = headline(report, found.remaining)
        write_json(report, out / "report.json")
        write_encoder(found, out)
        write_pictures(drawn, out)
        write_page(found, report, drawn, shlex.join(["python", "-m", "sci_lightning.diagnose", *sys.argv[1:]]), out)
    for logger in chosen_loggers(cfg, "diagnosis"):
        log(logger, report, drawn)
    print_report(report, sentence, console)
    console.say(styled(out / "report.html"), "; beside it report.json, encoder.yaml and pictures")
    lines = [invocation("train", "experiment=quickstart", paths={"encoder": out / "encoder.yaml"})]
    if (truth := Path(cfg.captures).with_suffix(".truth.json")).is_file():
        lines.append(invocation("virtual_camera.reveal", nearest(truth), nearest(out / "report.json")))
    print_next(console, *lines)


if __name__ == "__main__":
    run("diagnose", diagnose)
