"""What a capture that does not fit the others looks like: another sequence, scene or light, moved, saturated, dark.

Every mix-up that happens in a laboratory is tried on the capture, under the model of the other captures. The one that
explains it best is named if it explains nearly all of its misfit; else nothing is claimed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, combinations

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.gap import transferred
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import MaskShift

MAX_LEFT_BY_A_MIX_UP_SHARE = 0.1
"""Part of the excess of chi2 that an explanation may leave."""
LIGHT_FACTORS = (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.2, 1.4, 2.0, 2.8, 4.0, 8.0, 16.0)
"""Factors of the light that are tried; the best one is refined."""
LIGHT_REFINEMENTS = 6
MAX_EXCHANGE_SLOTS = 24
"""Slots up to which exchanges of any two slots are tried."""
TARGET_DISPLACEMENTS_PIXELS = (-6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0)
"""Displacements of the target, pixels, from which its displacement is fitted."""
MASK_DISPLACEMENTS_PIXELS = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
"""The same for the mask's image, which is finer."""
MIN_SATURATED_SHARE = 0.01
"""Part of the pixels at full scale from which a capture is called saturated."""


@dataclass(frozen=True)
class MixUp:
    """One thing that may have gone wrong with a capture.

    Attributes:
        words: a clause about it.
        chi2: what is left of the capture's misfit then.
    """

    words: str
    chi2: float


def appearance(fit: Fit, observation: Observation, place: int, others: torch.Tensor) -> str:
    """Return a clause that says what a capture looks like.

    Args:
        fit: the model of the other captures.
        observation: N captures.
        place: of the capture among them.
        others: ``(N,)`` bool, captures that fit.
    """
    only = torch.zeros(len(observation), dtype=torch.bool)
    only[place] = True
    one, good = observation.take(only), observation.take(others)
    fitter = fit.fitter
    model = transferred(fit, fitter.of_captures(one, fitted=True)).hypothesis
    stated = _chi2(fitter, model, one)[0]
    best: MixUp | None = None
    mislabelled = chain(_light(fitter, model, one), _labels(fitter, model, one, good))
    for group in (mislabelled, _moves(fitter, model, one)):
        candidates = [mix_up for mix_up in group if mix_up.chi2 - 1 <= MAX_LEFT_BY_A_MIX_UP_SHARE * (stated - 1)]
        best = min(candidates, key=lambda mix_up: mix_up.chi2, default=best)
        if best is not None:
            break
    words = [best.words] if best else ["no other label, light or position of it explains why"]
    full = float((one.dn >= one.full_scale).float().mean())
    if full > MIN_SATURATED_SHARE:
        words.append(f"{100 * full:.0f} % of its pixels are saturated")
    if not one.dn.any():
        words.append("all of its pixels read 0 DN")
    return ", and ".join(words)


def _chi2(fitter: Fitter, model: Hypothesis, alternatives: Observation) -> list[float]:
    """Return the mean squared distance, in standard deviations, of every capture from its prediction."""
    tried = fitter.of_captures(alternatives, fitted=True)
    prediction = tried.model.predict(model)
    mean = prediction.mean.clamp(0, alternatives.full_scale)
    squares = (tried.dn - mean).square() / (prediction.deviation.square() + 1 / 12)
    return [float(value) for value in squares.mean((1, 2), dtype=torch.float64)]


def _light(fitter: Fitter, model: Hypothesis, one: Observation) -> Iterator[MixUp]:
    """Try more and less light than stated."""

    def left(factors: list[float]) -> list[float]:
        return _chi2(fitter, model, _joined([replace(one, aperture=one.aperture * factor) for factor in factors]))

    tried = list(LIGHT_FACTORS)
    chi2 = left(tried)
    best = min(range(len(tried)), key=chi2.__getitem__)
    factor, reached = tried[best], chi2[best]
    step = 1.25
    for _ in range(LIGHT_REFINEMENTS if factor else 0):
        near = [factor / step, factor * step]
        values = left(near)
        if min(values) < reached:
            factor, reached = near[values.index(min(values))], min(values)
        else:
            step = step**0.5
    if not factor:
        yield MixUp("it looks as if no light had come in", reached)
    elif abs(factor - 1) > 0.02:
        yield MixUp(f"its light looks {factor:.3g} times as strong as stated", reached)


def _labels(fitter: Fitter, model: Hypothesis, one: Observation, good: Observation) -> Iterator[MixUp]:
    """Try other sequences, the scenes of other captures, and the labels of other captures as a whole."""
    own = one.sequences[0]
    tried: list[tuple[str, Observation]] = []
    seen = {tuple(own.tolist())}

    def sequence(words: str, slots: torch.Tensor) -> None:
        if tuple(slots.tolist()) not in seen:
            seen.add(tuple(slots.tolist()))
            tried.append((f"its sequence looks like {words}", replace(one, sequences=slots[None])))

    for number, which in enumerate(good.sequence.tolist()):
        slots = good.sequences[which]
        sequence(f"that of capture {int(good.number[number])} ({_listed(slots)})", slots)
    sequence("its own in reverse order", own.flip(0))
    for later in range(1, len(own)):
        sequence(f"its own, {later} slot{'s' * (later > 1)} later", own.roll(later))
    if len(own) <= MAX_EXCHANGE_SLOTS:
        for a, b in combinations(range(len(own)), 2):
            exchanged = own.clone()
            exchanged[a], exchanged[b] = own[b], own[a]
            sequence(f"its own with slots {a + 1} and {b + 1} exchanged", exchanged)
    for number in range(len(good)):
        name = int(good.number[number])
        slots = good.sequences[good.sequence[number]][None]
        tried.append((f"its scene looks like that of capture {name}", replace(one, scene=[good.scene[number]])))
        label = replace(one, scene=[good.scene[number]], sequences=slots, aperture=good.aperture[number][None])
        tried.append((f"sequence, scene and light look like those of capture {name}", label))
    chi2 = _chi2(fitter, model, _joined([observation for _, observation in tried]))
    for (words, _), reached in zip(tried, chi2, strict=True):
        yield MixUp(words, reached)


def _moves(fitter: Fitter, model: Hypothesis, one: Observation) -> Iterator[MixUp]:
    """Try displacements of the target, of the mask's image, and of both together (the sensor has moved)."""
    vocabulary = fitter.model.vocabulary
    movable = [name for name in ("scene_shift", "mask_shift") if name in vocabulary]
    kinds = {
        "scene_shift": ("its target", TARGET_DISPLACEMENTS_PIXELS),
        "mask_shift": ("its mask", MASK_DISPLACEMENTS_PIXELS),
    }
    size = one.size
    border = Border.around(max(abs(step) for step in TARGET_DISPLACEMENTS_PIXELS) + 1).limited(size, 0.25)
    inner = fitter.with_border(border)
    moves: list[tuple[tuple[str, ...], str, tuple[float, ...]]] = [((name,), *kinds[name]) for name in movable]
    if len(movable) == 2:
        moves.append((("scene_shift", "mask_shift"), "the whole picture", MASK_DISPLACEMENTS_PIXELS))
    for names, what, steps in moves:
        if names == ("scene_shift",) and one.scene[0].shape[1:] == (1, 1):
            continue  # an even target looks the same wherever it is
        starts = [_moved(model, names, dx, dy) for dx in steps for dy in steps]
        chi2 = [_chi2(inner, start, one)[0] for start in starts]
        best = starts[min(range(len(starts)), key=chi2.__getitem__)]
        moved, reached = _refined(inner, best, names, one)
        before = model.effects.get(names[0], {"dx": 0.0, "dy": 0.0})
        dx, dy = (float(moved.effects[names[0]][axis]) - float(before[axis]) for axis in ("dx", "dy"))
        yield MixUp(f"{what} looks displaced by ({dx:+.2g}, {dy:+.2g}) pixels", reached)


def _moved(model: Hypothesis, names: tuple[str, ...], dx: float, dy: float) -> Hypothesis:
    for name in names:
        own, farthest = model.effects.get(name, {"dx": 0.0, "dy": 0.0}), MaskShift.about["dx"].high
        moved = {"dx": float(own["dx"]) + dx, "dy": float(own["dy"]) + dy}
        model = model.with_effect(name, {axis: min(max(by, -farthest), farthest) for axis, by in moved.items()})
    return model


def _refined(fitter: Fitter, start: Hypothesis, names: tuple[str, ...], one: Observation) -> tuple[Hypothesis, float]:
    """Refine a displacement by halving steps; return the hypothesis and what is left of the misfit."""
    step, reached = 0.5, _chi2(fitter, start, one)[0]
    while step > 0.04:
        near = [_moved(start, names, dx, dy) for dx, dy in ((step, 0), (-step, 0), (0, step), (0, -step))]
        values = [_chi2(fitter, hypothesis, one)[0] for hypothesis in near]
        if min(values) < reached:
            start, reached = near[values.index(min(values))], min(values)
        else:
            step /= 2
    return start, reached


def _joined(captures: list[Observation]) -> Observation:
    """Return several observations of one capture each, of the same camera, as one."""
    first, count = captures[0], len(captures)
    return replace(
        first,
        sequences=torch.cat([one.sequences for one in captures]),
        sequence=torch.arange(count),
        scene=[one.scene[0] for one in captures],
        aperture=torch.cat([one.aperture for one in captures]),
        exposure=torch.cat([one.exposure for one in captures]),
        dn=torch.cat([one.dn for one in captures]),
        kinds=first.kinds * count,
        number=first.number.expand(count),
        position=None if first.position is None else first.position.expand(count),
        before=None if first.before is None else first.before.expand(count, -1, -1),
    )


def _listed(slots: torch.Tensor) -> str:
    """Return a sequence as people read it."""
    numbers = slots.tolist()
    shown = " ".join(map(str, numbers[:12]))
    return f"patterns {shown}{' ..' if len(numbers) > 12 else ''}"
