"""Which other effects explain the captures as well as a named one, and what to record to tell them apart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import torch

from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.information_criterion import with_common_pixels
from sci_lightning.diagnosis.fit.parameters import FreeParameters
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.search.screening import rivals

TEXTURE_SEED = 0
"""Seed of the textures."""
STRONG_LIGHT_FACTOR = 16.0
"""Light of captures whose pixels are nominally dark, relative to the nominal light, so that a small leak shows."""
NEEDED_NATS = 15.0
"""Nats that further captures must bring on average, so that they bring 6 in 19 of 20 cases: the log-likelihood ratio of
two Gaussian predictions that are d nats apart has mean d and variance 2 d, and d - 1.645 sqrt(2 d) = 6."""
MAX_FURTHER_CAPTURES = 50
"""Captures of one kind that somebody may reasonably be asked to record."""
MAX_SHOWN_NATS = 1000
"""Nats beyond which the text says "more than": the exact number means nothing there."""


@dataclass(frozen=True)
class Alternatives:
    """Effects that explain the captures as well as a named one.

    Attributes:
        lost: calibrated nats by which the captures are less likely with each of them, by name.
        tell_apart: what to record to tell them apart, in full sentences; empty without alternatives.
    """

    lost: Mapping[str, float]
    tell_apart: str

    @property
    def names(self) -> tuple[str, ...]:
        """Names of these effects."""
        return tuple(self.lost)

    def shares_beside(self, name: str) -> dict[str, float]:
        """Return how probable the named effect and each of these are if it is one of them, by name."""
        lost = {name: 0.0, **self.lost}
        least = min(lost.values())  # an alternative may turn out to be much the better one
        weights = {other: math.exp(least - nats) for other, nats in lost.items()}
        return {other: weight / sum(weights.values()) for other, weight in weights.items()}


@dataclass(frozen=True)
class Separation:
    """How captures of one kind separate two models, to second order.

    Attributes:
        apart: twice the nats by which one capture separates the models as they are fitted.
        shared: ``(p,)`` half the gradient of that with respect to the rival's parameters, with which it could follow.
        information: ``(p, p)`` of one further capture about the rival's parameters.
        known: ``(p, p)`` of the existing captures about them, which limits how far the rival can follow.
    """

    apart: float
    shared: torch.Tensor
    information: torch.Tensor
    known: torch.Tensor

    def __add__(self, other: Separation) -> Separation:
        """Return the separation by one capture of either kind together."""
        shared, information = self.shared + other.shared, self.information + other.information
        return Separation(self.apart + other.apart, shared, information, self.known)

    def nats(self, count: int) -> float:
        """Return the nats that ``count`` captures bring when the rival is refitted to all captures, old and new."""
        followed = torch.linalg.pinv(self.known + count * self.information, hermitian=True) @ self.shared
        return max(0.0, 0.5 * (count * self.apart - count**2 * float(self.shared @ followed)))

    def captures(self, needed: float, most: int) -> int | None:
        """Return how many captures bring so many nats; None if more than ``most`` do."""
        return next((count for count in range(1, most + 1) if self.nats(count) >= needed), None)


def alternatives(fit: Fit, without: Fit, name: str, dispersion: float = 1.0) -> Alternatives:
    """Find the alternatives to an effect in a fit.

    Args:
        fit: with the effect.
        without: the best fit without it.
        name: of the effect.
        dispersion: of its errors; a difference in nats is divided by it.
    """
    settings, effects = fit.fitter.settings, fit.fitter.model.effects
    lost, equal = dict[str, float](), dict[str, Fit]()
    if not fit.fitter.budget.allows(f"other effects in place of {name}", share=1.0):
        return Alternatives(lost, "")
    for other, rival in rivals(fit, without, name):
        named, instead = with_common_pixels(fit, rival)
        nats = (named.log_likelihood - instead.log_likelihood) / dispersion
        if nats < settings.indistinct_nats:
            lost[other], equal[other] = nats, rival
    # what is the same but for a plainer name is mentioned, and nobody is asked to record anything for it
    distinct = [rival for other, rival in equal.items() if effects[other].plainer != name]
    return Alternatives(lost, " ".join(tell_apart(fit, rival) for rival in distinct))


def tell_apart(one: Fit, rival: Fit) -> str:
    """Say which captures would tell two models apart, and how many of them.

    Every kind of :func:`further_captures` is predicted with both models. The kind that needs the fewest captures is
    chosen, and among equals the one that is simplest to record. If none is enough, pairs of kinds are considered: one
    capture may fix the size of an effect, and another one show its nature.
    """
    names = _names(one.hypothesis, rival.hypothesis)
    most = MAX_FURTHER_CAPTURES
    needed = NEEDED_NATS + max(0.0, rival.log_likelihood - one.log_likelihood)
    further = further_captures(one.fitter.model.observation)
    kinds = {kind: separate(observation, one, rival) for kind, observation in further.items()}
    pairs = {f"{a}, and as many of {b}": kinds[a] + kinds[b] for a, b in combinations(kinds, 2)}
    for options in (kinds, pairs):
        counts = {kind: separation.captures(needed, most) for kind, separation in options.items()}
        if any(counts.values()):
            best = min(options, key=lambda kind: counts[kind] or math.inf)
            count = counts[best] or 1
            nats = options[best].nats(count)
            gain = f"about {nats:,.0f} nats" if nats <= MAX_SHOWN_NATS else f"more than {MAX_SHOWN_NATS:,} nats"
            record = f"{'one capture' if count == 1 else f'{count} captures'} of {best}"
            return f"To tell {names}, record {record} ({gain}; {needed:.0f} are needed)."
    best = max(options, key=lambda kind: options[kind].nats(most))
    reach = f"even {most} captures of {best} would bring only {options[best].nats(most):.2g} nats"
    return (
        f"No practical number of captures tells {names}: {reach}, and {needed:.0f} are needed. At these values they "
        "predict nearly the same, so that either corrects the model alike."
    )


def separate(further: Observation, one: Fit, rival: Fit) -> Separation:
    """Compute how a further capture separates two models.

    Args:
        further: the capture.
        one: the model that is taken for the truth.
        rival: the other model, which may be refitted.
    """
    model = one.fitter.model.of_captures(further)
    truth, other = model.predict(one.hypothesis), model.predict(rival.hypothesis)
    weight = 2 / (truth.deviation.square() + other.deviation.square() + 1 / 6)
    inside = [prediction.mean.clamp(0, further.full_scale) for prediction in (truth, other)]
    change = inside[0] - inside[1]
    free = FreeParameters(model, rival.free)
    slopes = free.jacobian(rival.hypothesis, other) * (inside[1] == other.mean)
    weighted = (slopes * weight).flatten(1).double()
    return Separation(
        float((change.square() * weight).sum()),
        weighted @ change.flatten().double(),
        weighted @ slopes.flatten(1).double().T,
        rival.information.double(),
    )


def further_captures(observation: Observation) -> dict[str, Observation]:
    """Return one capture of every kind with the patterns of this camera; keys say what has to be recorded.

    Besides the usual kinds there are the coding patterns in reverse order and every second one twice in a row, and one
    open pattern with light in one slot only: its own, or one of the two after it. The simplest to record come first.
    Measurements are 0: only predictions are of use.
    """
    frames, (height, width) = observation.frames, observation.size
    random = torch.Generator().manual_seed(TEXTURE_SEED)
    texture = torch.nn.functional.interpolate(
        torch.rand(1, frames, height // 4 + 1, width // 4 + 1, generator=random), (height, width), mode="bilinear"
    )[0]
    coding = torch.arange(frames) % len(observation.patterns)
    means = observation.patterns.mean((1, 2))
    shown = frames // 2
    single, open_once = (torch.full((frames,), int(means.argmin())) for _ in range(2))
    single[shown] = int(observation.patterns[:frames].var((1, 2), correction=0).argmax())
    open_once[shown] = int(means.argmax())
    open_ = float(observation.patterns[coding].sum(0).mean().clamp(min=1e-3))
    flat, one = torch.ones(frames, 1, 1), torch.ones(1, 1, 1)

    def pulse(after: int) -> torch.Tensor:
        return flat * (torch.arange(frames) == (shown + after) % frames)[:, None, None]

    alone = f"the most open pattern in slot {shown + 1} of {frames} and the most closed one in all others"
    slot = [(shown + after) % frames + 1 for after in range(3)]
    kinds: dict[str, tuple[torch.Tensor, torch.Tensor, float, float]] = {
        "the dark with four times the exposure": (coding, 0 * flat, 1.0, 4.0),
        "a bright even scene behind the coding patterns": (coding, flat, 0.9 / open_, 1.0),
        "a dim even scene behind the coding patterns": (coding, flat, 0.2 / open_, 1.0),
        "a bright even scene behind one coding pattern, the most closed pattern in all other slots": (
            single,
            flat,
            0.9,
            1.0,
        ),
        "a texture at rest behind the coding patterns": (coding, texture[:1], 0.9 / open_, 1.0),
        "a moving texture behind the coding patterns": (coding, texture, 0.9 / open_, 1.0),
        "a moving texture behind the coding patterns in reverse order": (coding.flip(0), texture, 0.9 / open_, 1.0),
        "a moving texture behind every second coding pattern, each shown twice in a row": (
            coding // 2 * 2,
            texture,
            0.9 / open_,
            1.0,
        ),
        f"an even scene that is lit in slot {slot[0]} only, behind {alone}": (open_once, pulse(0), 0.9, 1.0),
    }
    for after in (1, 2):
        bright = f"{STRONG_LIGHT_FACTOR:.0f} times as bright"
        lit = f"an even scene that is lit in slot {slot[after]} only, {bright}, behind {alone}"
        kinds[lit] = (open_once, pulse(after), STRONG_LIGHT_FACTOR, 1.0)
    return {
        kind: replace(
            observation,
            sequences=sequence[None],
            sequence=torch.zeros(1, dtype=torch.long),
            scene=[scene],
            aperture=aperture * one,
            exposure=exposure * one,
            dn=torch.zeros(1, height, width),
            kinds=("further",),
            number=torch.zeros(1, dtype=torch.long),
            position=None,
            before=None,
        )
        for kind, (sequence, scene, aperture, exposure) in kinds.items()
    }


def _names(one: Hypothesis, other: Hypothesis) -> str:
    """Return the effects in which two hypotheses differ, as in "gain from mask_contrast"."""
    first = sorted(set(one.effects) - set(other.effects))
    second = sorted(set(other.effects) - set(one.effects))
    return f"{' and '.join(first)} from {' and '.join(second)}"
