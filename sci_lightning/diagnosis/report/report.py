"""The files of a diagnosis: ``report.json``, ``report.html``, pictures and ``encoder.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from omegaconf import OmegaConf

from sci_lightning import __version__
from sci_lightning.diagnosis.diagnosis import Diagnosis
from sci_lightning.diagnosis.report.report_page import report_page
from sci_lightning.encoder.empirical import Empirical
from sci_lightning.files.atomic_file import whole_file

UNCERTAINTY = (
    "Uncertainties are statistical only: one standard deviation, from the noise of the captures. Systematic errors, of "
    "the target, of the light or of the patterns as displayed, come on top. Digits beyond a thousandth of what an "
    "effect changes are not shown, because no formula is trusted further."
)
"""What ``std`` and ``systematic`` of the report mean, for people."""


def describe(found: Diagnosis) -> dict[str, Any]:
    """``report.json`` without its run time."""
    effects = [effect.describe() for effect in found.effects]
    assessments = {"before": found.before, "after": found.after}
    return {
        "format": "sci-diagnosis",
        "format_version": 1,
        "verdict": found.verdict,
        "effects": effects,
        "uncertainty": UNCERTAINTY,
        "gap": {when: assessment.gap.describe() for when, assessment in assessments.items()},
        "unnamed": [
            {"stage": each.stage, "where": each.where, "p_value": each.p_value, "picture": f"unnamed_{number}.png"}
            for number, each in enumerate(found.unnamed, start=1)
        ],
        "where": {when: [test.describe() for test in each.tests] for when, each in assessments.items()},
        "noise": {
            **{
                name: each
                for name, each in found.after.fit.hypothesis.effects.items()
                if found.model.effects[name].noise
            },
            "stated_by_the_file": list(found.stated_noise),
        },
        "next_captures": list(dict.fromkeys(each["tell_apart"] for each in effects if each["tell_apart"])),
        "split": found.split.describe(),
        "seed": found.seed,
        "sci_lightning": __version__,
    }


def write_pictures(drawn: Mapping[str, Figure], out: str | Path) -> None:
    """PNG files by name."""
    for name, figure in drawn.items():
        with whole_file(Path(out) / name) as temporary:
            figure.savefig(temporary, dpi=150, facecolor="white", bbox_inches="tight")  # no label is cut off


def write_page(
    found: Diagnosis, report: Mapping[str, Any], drawn: Mapping[str, Figure], command: str, out: str | Path
) -> None:
    """``report.html``; see :func:`~sci_lightning.diagnosis.report.report_page.report_page`."""
    with whole_file(Path(out) / "report.html") as temporary:
        temporary.write_text(report_page(found, report, drawn, command), encoding="utf-8")


def write_encoder(found: Diagnosis, out: str | Path) -> None:
    """The corrected encoder: ``encoder.yaml``, with the patterns and maps it names beside it."""
    out = Path(out)
    seen, fit = found.observation, found.after.fit
    coding = seen.sequences[torch.tensor([len(set(each.tolist())) for each in seen.sequences]).argmax()]
    patterns = seen.patterns[coding].numpy()
    slots, height, width = patterns.shape
    _save(out / "patterns.npy", patterns)
    effects: dict[str, Any] = {}
    for name, values in fit.hypothesis.effects.items():
        effect = found.model.effects[name]
        if issubclass(effect, Empirical) and effect.of_captures:
            continue
        effects[name] = {"_target_": f"{effect.__module__}.{effect.__qualname__}", **values}
        if issubclass(effect, Empirical):
            effects[name]["count"] = effect.count
        if effect.map_kind and name in fit.hypothesis.maps:
            scale = float(values["std"]) if "std" in values else 1.0
            _save(out / f"{name}.npy", (fit.hypothesis.maps[name] / max(scale, 1e-12)).numpy())
            effects[name] |= {"file": f"{name}.npy", "size": [height, width]}
    mask = {"file": "patterns.npy", "key": None, "frames": slots, "size": [height, width]}
    content = {
        "_target_": "sci_lightning.encoder.Encoder",
        "aperture": "auto",
        "mask": {"_target_": "sci_lightning.encoder.mask.Measured", **mask},
        "sensor": {"_target_": "sci_lightning.encoder.sensor.ClipQuantise", "bit_depth": seen.bit_depth},
        "effects": effects,
    }
    with whole_file(out / "encoder.yaml") as temporary:
        OmegaConf.save(OmegaConf.create(content), temporary)


def _save(path: Path, array: np.ndarray) -> None:
    with whole_file(path) as temporary:
        np.save(temporary, array.astype(np.float32))
