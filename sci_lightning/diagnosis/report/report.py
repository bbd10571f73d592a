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
from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.report.digits import systematic_limit
from sci_lightning.diagnosis.report.report_page import report_page
from sci_lightning.diagnosis.search.alternatives import Alternatives, alternatives
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
    effects = describe_effects(found.fitter, found.complete, list(found.names))
    return {
        "format": "sci-diagnosis",
        "format_version": 1,
        "verdict": found.verdict,
        "effects": effects,
        "uncertainty": UNCERTAINTY,
        "gap": found.gaps,
        "unnamed": [
            {"stage": each.stage, "where": each.where, "p_value": each.p_value, "picture": f"unnamed_{number}.png"}
            for number, each in enumerate(found.unnamed, start=1)
        ],
        "where": {when: [test.describe() for test in tests] for when, tests in found.where.items()},
        "noise": {
            **{
                name: each
                for name, each in found.after.hypothesis.effects.items()
                if found.fitter.model.known[name].noise
            },
            "stated_by_the_file": list(found.stated),
        },
        "next_captures": list(dict.fromkeys(each["tell_apart"] for each in effects if each["tell_apart"])),
        "split": found.fitter.split.describe(),
        "seed": found.seed,
        "sci_lightning": __version__,
    }


def describe_effects(fitter: Fitter, fit: Fit, names: list[str]) -> list[dict[str, Any]]:
    """Every found effect: parameters with standard deviations, and what the captures lose without it."""
    covariance = torch.linalg.pinv(fit.information) if fit.free else fit.information
    deviation = dict(zip(fit.free, covariance.diagonal().clamp(min=0).sqrt().tolist(), strict=True))
    found = []
    for name in names:
        effect = fitter.model.known[name]
        parameters = {}
        for parameter, about in effect.about.items():
            value = fit.hypothesis.effects[name][parameter]
            std = deviation.get((name, parameter), 0.0) * (float(value) if about.log else 1.0)
            if name in fit.charts:
                std = fit.charts[name].std_error
            content = {"value": value, "std": std, "systematic": systematic_limit(value, about), "unit": about.unit}
            parameters[parameter] = content
        evidence, other = {}, Alternatives((), "")
        if not effect.noise:
            without = fitter.fit(fit.hypothesis.without(name))
            other, lost = alternatives(fitter, fit, without, name), fit.total - without.total
            evidence = {"delta_nll": lost, "delta_bic": 2 * lost - len(parameters) * float(np.log(fitter.use.numel()))}
        found.append(
            {
                "name": name,
                "stage": effect.stage,
                "parameters": parameters,
                "evidence": evidence,
                "alternatives": list(other.names),
                "tell_apart": other.tell_apart,
            }
        )
    return found


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


def write_encoder(fitter: Fitter, fit: Fit, out: str | Path) -> None:
    """The corrected encoder: ``encoder.yaml``, with the patterns and maps it names beside it."""
    out = Path(out)
    seen = fitter.model.observation
    coding = seen.sequences[torch.tensor([len(set(each.tolist())) for each in seen.sequences]).argmax()]
    patterns = seen.patterns[coding].numpy()
    slots, height, width = patterns.shape
    _save(out / "patterns.npy", patterns)
    effects: dict[str, Any] = {}
    for name, values in fit.hypothesis.effects.items():
        effect = fitter.model.known[name]
        if issubclass(effect, Empirical) and effect.of_captures:
            continue
        effects[name] = {"_target_": f"{effect.__module__}.{effect.__qualname__}", **values}
        if issubclass(effect, Empirical):
            effects[name]["count"] = effect.count
        if effect.map_kind and name in fit.hypothesis.charts:
            scale = float(values["std"]) if "std" in values else 1.0
            _save(out / f"{name}.npy", (fit.hypothesis.charts[name] / max(scale, 1e-12)).numpy())
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
