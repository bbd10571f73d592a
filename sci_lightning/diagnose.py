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
    from sci_lightning import __version__
    from sci_lightning.captures import read_captures
    from sci_lightning.diagnosis.camera_model import CameraModel
    from sci_lightning.diagnosis.fit import Fitter
    from sci_lightning.diagnosis.gap import gap
    from sci_lightning.diagnosis.noise import settle, stated
    from sci_lightning.diagnosis.observation import observe
    from sci_lightning.diagnosis.report import describe_effects, verdict, write_encoder
    from sci_lightning.diagnosis.search import search
    from sci_lightning.diagnosis.split import split
    from sci_lightning.results import write_json

    start, out, console = time.perf_counter(), Path(cfg.out), Console(highlight=False)
    observation = observe(read_captures(cfg.captures))
    fitter = Fitter(CameraModel(observation, vocabulary()), split(observation))
    noise, fixed = stated(fitter)
    before = gap(fitter, fitter.fit(noise, fixed=fixed, iterations=30), cfg.seed)
    with console.status("searching") as status:
        found = search(fitter, noise, cfg.most, lambda name, gain: status.update(f"{name}: {gain:.0f} nats"))
        found, differing = settle(fitter, found)
    names = [name for name in found.hypothesis.effects if name not in noise.effects] + differing
    after = gap(fitter, found, cfg.seed)
    report = {
        "format": "sci-diagnosis",
        "format_version": 1,
        "verdict": verdict(names, after["chi2"], before["chi2"]),
        "effects": describe_effects(fitter, found, names),
        "gap": {"before": before, "after": after},
        "unnamed": [],
        "noise": {
            **{name: found.hypothesis.effects[name] for name in noise.effects},
            "stated_by_the_file": [name for name, _ in fixed],
        },
        "split": fitter.split.describe(),
        "runtime_s": time.perf_counter() - start,
        "seed": cfg.seed,
        "sci_lightning": __version__,
    }
    write_encoder(fitter, found, out)
    write_json(report, out / "report.json")
    console.print(f"[bold]{report['verdict']}[/]: held-out chi2 {before['chi2']:.4g} before, {after['chi2']:.4g} after")
    for effect in report["effects"]:
        values = ", ".join(
            f"{key} {each['value']:.5g} +- {each['std']:.2g} {each['unit']}"
            if isinstance(each["value"], float)
            else f"{key} {each['value']} {each['unit']}"
            for key, each in effect["parameters"].items()
        )
        console.print(f"  {effect['stage']}: {effect['name']} ({values})")
    console.print(f"[bold]{out}[/]: report.json, encoder.yaml")


def vocabulary() -> dict[str, type]:
    """Every effect of the package by name."""
    from sci_lightning.encoder import effects

    members = [getattr(effects, each) for each in effects.__all__]
    return {each.name: each for each in members if hasattr(each, "name")}


if __name__ == "__main__":
    run("diagnose", diagnose)
