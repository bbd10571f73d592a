"""Which other effects the captures cannot tell from one that was found, and which capture would."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from sci_lightning.diagnosis.camera_model import CameraModel, Hypothesis
from sci_lightning.diagnosis.fit import Fit, Fitter
from sci_lightning.diagnosis.observation import Observation
from sci_lightning.diagnosis.rivals import rivals

DISTINCT = 6.0
"""Nats by which the captures must prefer one effect to another, or they cannot tell them apart."""
SEED = 0
"""Of the textures of imagined captures."""


@dataclass(frozen=True)
class Alternatives:
    """Attributes:
    names: effects that explain the captures as well in the place of the one found.
    tell_apart: the capture that would tell, in words; empty without alternatives.
    """

    names: tuple[str, ...]
    tell_apart: str


def alternatives(fitter: Fitter, fit: Fit, without: Fit, name: str) -> Alternatives:
    """Of an effect in a fit.

    Args:
        fitter: of the captures.
        fit: with the effect.
        without: the best fit without it.
        name: of the effect.
    """
    equal = {other: each for other, each in rivals(fitter, fit, without, name) if each.total > fit.total - DISTINCT}
    return Alternatives(tuple(equal), "; ".join(tell_apart(fitter, fit, each) for each in equal.values()))


def tell_apart(fitter: Fitter, one: Fit, other: Fit) -> str:
    """The kind of capture that two models predict most differently, in words."""
    nats = {}
    for kind, imagined in imagined_captures(fitter.model.observation).items():
        model = CameraModel(imagined, fitter.model.known)
        a, b = model.predict(one.hypothesis), model.predict(other.hypothesis)
        variance = (a.deviation.square() + b.deviation.square()) / 2 + 1 / 12
        inside = [prediction.mean.clamp(0, imagined.full_scale) for prediction in (a, b)]
        nats[kind] = float(((inside[0] - inside[1]).square() / (2 * variance)).sum())
    best = max(nats, key=nats.__getitem__)
    names = _names(one.hypothesis, other.hypothesis)
    if nats[best] < 0.5:
        return f"no capture of these kinds tells {names}"
    return f"{best}: one tells {names} by about {nats[best]:.0f} nats"


def _names(one: Hypothesis, other: Hypothesis) -> str:
    first = sorted(set(one.effects) - set(other.effects))
    second = sorted(set(other.effects) - set(one.effects))
    return f"{' and '.join(first)} from {' and '.join(second)}"


def imagined_captures(seen: Observation) -> dict[str, Observation]:
    """One capture of each kind that a laboratory can take, with this camera's patterns: by what it is."""
    frames, (height, width) = seen.frames, seen.size
    random = torch.Generator().manual_seed(SEED)
    texture = torch.nn.functional.interpolate(
        torch.rand(1, frames, height // 4 + 1, width // 4 + 1, generator=random), (height, width), mode="bilinear"
    )[0]
    coding = torch.arange(frames) % len(seen.patterns)
    dimmest = int(seen.patterns.mean((1, 2)).argmin())
    single = torch.full((frames,), dimmest)
    single[frames // 2] = int(seen.patterns[:frames].var((1, 2)).argmax())
    open_ = float(seen.patterns[coding].sum(0).mean().clamp(min=1e-3))
    flat, one = torch.ones(frames, 1, 1), torch.ones(1, 1, 1)
    kinds: dict[str, tuple[torch.Tensor, torch.Tensor, float, float]] = {
        "a dark frame of four times the exposure": (coding, 0 * flat, 1.0, 4.0),
        "a bright flat field behind the coding patterns": (coding, flat, 0.9 / open_, 1.0),
        "a dim flat field behind the coding patterns": (coding, flat, 0.2 / open_, 1.0),
        "a single pattern over an even scene": (single, flat, 0.9, 1.0),
        "a texture at rest behind the coding patterns": (coding, texture[:1], 0.9 / open_, 1.0),
        "a moving texture behind the coding patterns": (coding, texture, 0.9 / open_, 1.0),
    }
    return {
        kind: replace(
            seen,
            sequences=sequence[None],
            sequence=torch.zeros(1, dtype=torch.long),
            scene=[scene],
            aperture=aperture * one,
            exposure=exposure * one,
            dn=torch.zeros(1, height, width),
            kinds=("imagined",),
            number=torch.zeros(1, dtype=torch.long),
        )
        for kind, (sequence, scene, aperture, exposure) in kinds.items()
    }
