"""``report.json`` and ``encoder.yaml`` of a diagnosis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from omegaconf import OmegaConf

from sci_lightning import __version__
from sci_lightning.atomic_file import whole_file
from sci_lightning.diagnosis.alternatives import Alternatives, alternatives
from sci_lightning.diagnosis.diagnosis import Diagnosis
from sci_lightning.diagnosis.fit import Fit, Fitter


def describe(found: Diagnosis) -> dict[str, Any]:
    """``report.json`` without its run time."""
    return {
        "format": "sci-diagnosis",
        "format_version": 1,
        "verdict": found.verdict,
        "effects": describe_effects(found.fitter, found.after, list(found.names)),
        "gap": found.gaps,
        "unnamed": [{"stage": each.stage, "where": each.where, "p_value": each.p_value} for each in found.unnamed],
        "noise": {
            **{
                name: each
                for name, each in found.after.hypothesis.effects.items()
                if found.fitter.model.known[name].noise
            },
            "stated_by_the_file": list(found.stated),
        },
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
            parameters[parameter] = {"value": value, "std": std, "unit": about.unit}
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


def write_encoder(fitter: Fitter, fit: Fit, out: Path) -> None:
    """The corrected encoder: ``encoder.yaml``, with the patterns and maps it names beside it."""
    seen = fitter.model.observation
    coding = seen.sequences[torch.tensor([len(set(each.tolist())) for each in seen.sequences]).argmax()]
    _save(out / "patterns.npy", seen.patterns[coding].numpy())
    effects: dict[str, Any] = {}
    for name, values in fit.hypothesis.effects.items():
        effect = fitter.model.known[name]
        effects[name] = {"_target_": f"{effect.__module__}.{effect.__qualname__}", **values}
        if effect.chart and name in fit.hypothesis.charts:
            scale = float(values["std"]) if "std" in values else 1.0
            _save(out / f"{name}.npy", (fit.hypothesis.charts[name] / max(scale, 1e-12)).numpy())
            effects[name] |= {"file": f"{name}.npy", "size": "${size}"}
    mask = {"file": "patterns.npy", "key": None, "frames": "${frames}", "size": "${size}"}
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
