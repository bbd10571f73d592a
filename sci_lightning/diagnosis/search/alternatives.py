"""Which other effects the captures cannot tell from one that was found, and what to record to tell them apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.split import Split
from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.diagnosis.search.imagined_captures import imagined_captures
from sci_lightning.diagnosis.search.rivals import rivals

MANY = 1000
"""Nats beyond which their number tells nothing more."""


@dataclass(frozen=True)
class Alternatives:
    """Attributes:
    names: effects that explain the captures as well in the place of the one found.
    tell_apart: what to record to tell them from it, in full sentences; empty without alternatives.
    """

    names: tuple[str, ...]
    tell_apart: str


@dataclass(frozen=True)
class Separation:
    """What captures of one kind say about which of two models is right, to second order.

    Attributes:
        apart: nats, twice, by which one capture tells the models as they are.
        shared: ``(p,)`` slope of that by the rival's parameters: how far these could make up for the difference.
        information: ``(p, p)`` of one capture about the rival's parameters.
        known: ``(p, p)`` of the captures at hand about them, which keeps them from making up for all of it.
    """

    apart: float
    shared: torch.Tensor
    information: torch.Tensor
    known: torch.Tensor

    def __add__(self, other: Separation) -> Separation:
        """Return what one capture of each of two kinds says together."""
        shared, information = self.shared + other.shared, self.information + other.information
        return Separation(self.apart + other.apart, shared, information, self.known)

    def nats(self, count: int) -> float:
        """Return what ``count`` captures would tell, the rival refitted to all captures, old and new."""
        made_up = torch.linalg.pinv(self.known + count * self.information, hermitian=True) @ self.shared
        return max(0.0, 0.5 * (count * self.apart - count**2 * float(self.shared @ made_up)))

    def captures(self, needed: float, most: int) -> int | None:
        """Return how many captures bring so many nats; None if more than ``most`` do."""
        return next((count for count in range(1, most + 1) if self.nats(count) >= needed), None)


def alternatives(fitter: Fitter, fit: Fit, without: Fit, name: str) -> Alternatives:
    """Find the alternatives to an effect in a fit.

    Args:
        fitter: of the captures.
        fit: with the effect.
        without: the best fit without it.
        name: of the effect.
    """
    least = fit.total - fitter.settings.indistinct_nats
    equal = {other: rival for other, rival in rivals(fitter, fit, without, name) if rival.total > least}
    return Alternatives(tuple(equal), " ".join(tell_apart(fitter, fit, rival) for rival in equal.values()))


def tell_apart(fitter: Fitter, one: Fit, rival: Fit) -> str:
    """Say which captures would tell two models apart, and how many of them.

    Each kind of :func:`imagined_captures` is predicted with both models. The kind that needs the fewest captures is
    chosen, and among equals the one that is simplest to record. If none is enough, pairs of kinds are considered: one
    capture may fix the size of an effect, and another one show its nature.
    """
    names = _names(one.hypothesis, rival.hypothesis)
    settings = fitter.settings
    most, needed = settings.max_further_captures, settings.needed_nats + max(0.0, rival.total - one.total)
    seen = fitter.model.observation
    kinds = {kind: separation(fitter, imagined, one, rival) for kind, imagined in imagined_captures(seen).items()}
    pairs = {f"{a}, and as many of {b}": kinds[a] + kinds[b] for a, b in combinations(kinds, 2)}
    for options in (kinds, pairs):
        counts = {kind: each.captures(needed, most) for kind, each in options.items()}
        if any(counts.values()):
            best = min(options, key=lambda kind: counts[kind] or math.inf)
            count = counts[best] or 1
            nats = options[best].nats(count)
            worth = f"about {nats:,.0f} nats" if nats <= MANY else f"more than {MANY:,} nats"
            record = f"{'one capture' if count == 1 else f'{count} captures'} of {best}"
            return f"To tell {names}, record {record} ({worth}; {needed:.0f} are needed)."
    best = max(options, key=lambda kind: options[kind].nats(most))
    reach = f"even {most} captures of {best} would bring only {options[best].nats(most):.2g} nats"
    return (
        f"No practical number of captures tells {names}: {reach}, and {needed:.0f} are needed. At these values they "
        "predict nearly the same, so that either corrects the model alike."
    )


def separation(fitter: Fitter, imagined: Observation, one: Fit, rival: Fit) -> Separation:
    """Compute how a capture that is imagined separates two models.

    Args:
        fitter: of the captures at hand.
        imagined: the capture.
        one: the model taken for the truth.
        rival: the model that is to be told from it.
    """
    model = CameraModel(imagined, fitter.model.known)
    there = Fitter(model, Split(torch.ones_like(imagined.dn, dtype=torch.bool), (), torch.zeros(1, dtype=torch.bool)))
    truth, other = model.predict(one.hypothesis), model.predict(rival.hypothesis)
    weight = 2 / (truth.deviation.square() + other.deviation.square() + 1 / 6)
    inside = [prediction.mean.clamp(0, imagined.full_scale) for prediction in (truth, other)]
    change = inside[0] - inside[1]
    free = list(rival.free)
    slopes = there.jacobian(rival.hypothesis, free, other) * (inside[1] == other.mean)
    weighted = (slopes * weight).flatten(1).double()
    return Separation(
        float((change.square() * weight).sum()),
        weighted @ change.flatten().double(),
        weighted @ slopes.flatten(1).double().T,
        rival.information.double(),
    )


def _names(one: Hypothesis, other: Hypothesis) -> str:
    first = sorted(set(one.effects) - set(other.effects))
    second = sorted(set(other.effects) - set(one.effects))
    return f"{' and '.join(first)} from {' and '.join(second)}"
