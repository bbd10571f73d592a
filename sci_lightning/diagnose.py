"""``python -m sci_lightning.diagnose``: where do captures and model disagree, and which effect is missing?"""

from __future__ import annotations

import time
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console

from sci_lightning.command import run


def diagnose(cfg: DictConfig) -> None:
    """Write ``report.json`` and ``encoder.yaml``, and print what was found.

    Args:
        cfg: ``conf/diagnose.yaml``, composed.
    """
    from sci_lightning.captures import read_captures
    from sci_lightning.diagnosis.diagnosis import diagnose
    from sci_lightning.diagnosis.report import describe, write_encoder
    from sci_lightning.diagnosis.vocabulary import vocabulary
    from sci_lightning.results import write_json

    start, out, console = time.perf_counter(), Path(cfg.out), Console(highlight=False)
    captures = read_captures(cfg.captures)
    with console.status("searching") as status:
        found = diagnose(captures, vocabulary(cfg.candidates), cfg.seed, cfg.most, status.update)
    report = describe(found) | {"runtime_s": time.perf_counter() - start}
    write_encoder(found.fitter, found.after, out)
    write_json(report, out / "report.json")
    chi2 = {when: each["chi2"] for when, each in report["gap"].items()}
    console.print(f"[bold]{found.verdict}[/]: held-out chi2 {chi2['before']:.4g} before, {chi2['after']:.4g} after")
    for effect in report["effects"]:
        values = ", ".join(
            f"{key} {each['value']:.5g} +- {each['std']:.2g} {each['unit']}"
            if isinstance(each["value"], float)
            else f"{key} {each['value']} {each['unit']}"
            for key, each in effect["parameters"].items()
        )
        console.print(f"  {effect['stage']}: {effect['name']} ({values})")
    console.print(f"[bold]{out}[/]: report.json, encoder.yaml")


if __name__ == "__main__":
    run("diagnose", diagnose)
