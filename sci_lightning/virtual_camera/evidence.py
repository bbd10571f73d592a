"""How strongly captures speak for what is hidden in them, and effects made so weak that they speak softly."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import log_ndtr

from sci_lightning.virtual_camera.hardware.camera import VirtualCamera
from sci_lightning.virtual_camera.hardware.converter import BitDepth, ReadNoise
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.session import Session
from sci_lightning.virtual_camera.shots import Shots
from sci_lightning.virtual_camera.stream import stream

WEAK = (30.0, 100.0)
"""Log-likelihood gained by the true model, for an effect to be called weak."""


def log_likelihood(camera: VirtualCamera, light: np.ndarray, shots: Shots, dn: np.ndarray) -> float:
    """Log-probability of the DN if ``camera`` took them: that of the interval each stands for, tails at the ends.

    The noise is taken as Gaussian with the camera's own shot and read noise; ``light`` is the camera's, without noise.
    """
    (read,), (converter,) = camera.of(ReadNoise), camera.of(BitDepth)
    shot = camera.signal(light, shots, deviations=1) - camera.signal(light, shots, deviations=-1)
    deviation = np.hypot(shot / 2, max(read.std, 0.05) / camera.full_scale)
    start, stop = converter.interval(dn.astype(np.float64), camera.full_scale)
    mean = camera.signal(light, shots)
    below, above = (start - mean) / deviation, (stop - mean) / deviation
    # of the two ways to write the interval's probability, the one that does not subtract numbers near 1
    swap = below > 0
    below, above = np.where(swap, -above, below), np.where(swap, -below, above)
    larger, smaller = log_ndtr(above), log_ndtr(below)
    return float((larger + np.log1p(-np.exp(np.minimum(smaller - larger, -1e-12)))).sum())


def log_likelihood_gains(
    session: Session, effects: dict[str, Effect], seed: int, shots: Shots, dn: np.ndarray
) -> tuple[float, dict[str, float]]:
    """How much likelier the captures are with what is hidden in the camera than without: nats.

    Noise other than the pixels' own shot and read noise (a fluttering row) counts for nothing.

    Returns:
        of everything hidden, maps included, and of each effect by name when the others are known. There, of a Gaussian
        map only the standard deviation counts as known. Near 0: nobody could see the effect beside the others.
    """

    def of(present: dict[str, Effect]) -> float:
        camera = VirtualCamera(session, present, seed)
        return log_likelihood(camera, camera.light(shots), shots, dn)

    hidden, ideal = of(effects), of({})
    gains = {}
    for name, effect in effects.items():
        others = {each: other for each, other in effects.items() if each != name}
        gains[name] = hidden - (of(others) if others else ideal)
        if effect.gaussian:
            chart = VirtualCamera(session, {name: effect}, seed).charts[name]
            gains[name] = _without_map(gains[name], chart.size)
    return hidden - ideal, gains


def weak(effect: Effect, session: Session, seed: int) -> Effect:
    """The effect with its magnitudes reduced until its captures gain 30 to 100 nats from knowing it.

    Of a Gaussian map only the standard deviation counts as known.

    The gain grows about as the square of the magnitude, so a few steps suffice. An effect without a magnitude to
    reduce (a pattern order, a bit depth), or whose smallest step speaks more loudly (one hot pixel), stays clear.
    """
    if effect.weakened(0.5, session) == effect:
        return effect
    shots = session.shots(seed)
    ideal = VirtualCamera(session, {}, seed)
    without = ideal.light(shots)
    goal = math.exp(stream(seed, "weak").uniform(math.log(WEAK[0] * 1.3), math.log(WEAK[1] / 1.3)))
    share, tried = 1.0, []
    for _ in range(8):
        candidate = effect.weakened(share, session)
        camera = VirtualCamera(session, {effect.name: candidate}, seed)
        light = camera.light(shots)
        dn = camera.convert(camera.signal(light, shots, stream(seed, "noise")))
        gain = log_likelihood(camera, light, shots, dn) - log_likelihood(ideal, without, shots, dn)
        if effect.gaussian:
            gain = _without_map(gain, camera.charts[effect.name].size)
        tried.append((abs(math.log(max(gain, 1e-3) / goal)), candidate))
        if WEAK[0] <= gain <= WEAK[1]:
            break
        share = min(share * math.sqrt(goal / max(gain, goal / 25)), 1.0)
    return min(tried, key=lambda each: each[0])[1]


def _without_map(gain: float, elements: int) -> float:
    """What is left of the gain when a Gaussian map has to be learned from the same captures.

    Where the captures tell each element with a precision of r times its own variance, knowing the map is worth r / 2
    nats an element, and knowing only its standard deviation (r - log(1 + r)) / 2.
    """
    r = 2 * max(gain, 0.0) / elements
    return elements * (r - math.log1p(r)) / 2
