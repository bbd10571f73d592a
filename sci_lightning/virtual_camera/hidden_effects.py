"""Which effects are hidden (given, named, or drawn from the seed), and how strongly captures speak for them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from scipy.special import log_ndtr

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.hardware.camera import Camera
from sci_lightning.virtual_camera.hardware.converter import BitDepth, ReadNoise
from sci_lightning.virtual_camera.hardware.effect import Effect, Value
from sci_lightning.virtual_camera.hardware.vocabulary import DRAWN, EFFECTS, OUTSIDE
from sci_lightning.virtual_camera.random_numbers import stream
from sci_lightning.virtual_camera.rays.ray_camera import build_camera
from sci_lightning.virtual_camera.session import Acquisition, Session

GAINS = {"weak": (30.0, 100.0), "faint": (3.0, 30.0)}
"""Gain in log-likelihood (nats) by the true model for which an effect is called weak, or so faint as to be doubtful."""

MIN_READ_NOISE = 0.05
"""DN; a smaller read noise is taken as this one, so that no capture is infinitely unlikely."""


def log_likelihood(camera: Camera, light: np.ndarray, acquisition: Acquisition, dn: np.ndarray) -> float:
    """Return the log-probability (nats) of raw DN if ``camera`` had recorded them.

    It is the Gaussian probability of the interval of signals that every DN stands for, open at both ends of the range,
    with the camera's own shot and read noise as the variance.

    Args:
        camera: whose captures they are supposed to be.
        light: (N, H, W) its noise-free irradiance, see :meth:`.Camera.irradiance`.
        acquisition: the input of the captures.
        dn: (N, H, W) raw DN.
    """
    brighter = camera.signal(light, acquisition, shot_noise_sigmas=1)
    darker = camera.signal(light, acquisition, shot_noise_sigmas=-1)
    read_noise = max(camera.part(ReadNoise).std, MIN_READ_NOISE) / camera.full_scale
    deviation = np.hypot((brighter - darker) / 2, read_noise)
    start, stop = camera.part(BitDepth).interval(dn.astype(np.float64), camera.full_scale)
    mean = camera.signal(light, acquisition)
    below, above = (start - mean) / deviation, (stop - mean) / deviation
    # P(a < z < b) = P(-b < z < -a): use the form that does not subtract two numbers close to 1
    swap = below > 0
    below, above = np.where(swap, -above, below), np.where(swap, -below, above)
    larger, smaller = log_ndtr(above), log_ndtr(below)
    return float((larger + np.log1p(-np.exp(np.minimum(smaller - larger, -1e-12)))).sum())


def log_likelihood_gains(
    session: Session, effects: Mapping[str, Effect], seed: int, acquisition: Acquisition, dn: np.ndarray
) -> tuple[float, dict[str, float]]:
    """Return how much likelier the captures are with the hidden effects in the camera than without them, in nats.

    Noise other than the pixels' own shot and read noise (row flutter, for example) is not part of the likelihood.

    Returns:
        The gain by all effects together, with their maps known; and by name the gain of every effect when the others
        are known, where only the standard deviation of a Gaussian map counts as known. A gain near 0 means that nobody
        could detect the effect beside the others.
    """

    def log_likelihood_with(present: Mapping[str, Effect]) -> float:
        camera = build_camera(session, present, seed)
        return log_likelihood(camera, camera.irradiance(acquisition), acquisition, dn)

    with_all, with_none = log_likelihood_with(effects), log_likelihood_with({})
    gains = {}
    for name, effect in effects.items():
        others = {other: present for other, present in effects.items() if other != name}
        gains[name] = with_all - (log_likelihood_with(others) if others else with_none)
        if effect.gaussian_map:
            values = build_camera(session, {name: effect}, seed).fixed_maps[name]
            gains[name] = _gain_with_unknown_map(gains[name], values.size)
    return with_all - with_none, gains


def make_weak(effect: Effect, session: Session, seed: int, gains: tuple[float, float]) -> Effect:
    """Return the effect with its magnitudes reduced until knowing it gains so many nats of log-likelihood.

    Only the standard deviation of a Gaussian map counts as known. The gain grows about as the square of the magnitude,
    so that a few steps suffice. An effect without a magnitude to reduce (a pattern order, a bit depth) is returned as
    it is; one whose smallest step already gains more (one hot pixel) is returned with the nearest gain.
    """
    if effect.weakened(0.5, session) == effect:
        return effect
    acquisition = session.acquisition(seed)
    ideal = build_camera(session, {}, seed)
    ideal_light = ideal.irradiance(acquisition)
    low, high = gains
    goal = math.exp(stream(seed, "weak").uniform(math.log(low * 1.3), math.log(high / 1.3)))
    share = 1.0
    candidates: list[tuple[float, Effect]] = []
    for _ in range(8):
        candidate = effect.weakened(share, session)
        camera = build_camera(session, {effect.name: candidate}, seed)
        light = camera.irradiance(acquisition)
        dn = camera.convert(camera.signal(light, acquisition, stream(seed, "noise")))
        gain = log_likelihood(camera, light, acquisition, dn) - log_likelihood(ideal, ideal_light, acquisition, dn)
        if effect.gaussian_map:
            gain = _gain_with_unknown_map(gain, camera.fixed_maps[effect.name].size)
        candidates.append((abs(math.log(max(gain, 1e-3) / goal)), candidate))
        if low <= gain <= high:
            break
        share = min(share * math.sqrt(goal / max(gain, goal / 25)), 1.0)
    return min(candidates, key=lambda candidate: candidate[0])[1]


def _gain_with_unknown_map(gain: float, elements: int) -> float:
    """Return the gain that remains when a Gaussian map has to be estimated from the same captures.

    If the captures determine every element with a precision of r times its own variance, knowing the map gains r / 2
    nats per element, and knowing only its standard deviation (r - log(1 + r)) / 2.
    """
    r = 2 * max(gain, 0.0) / elements
    return elements * (r - math.log1p(r)) / 2


Parameters: TypeAlias = Mapping[str, Value]
EffectRequest: TypeAlias = str | Sequence[str | Parameters] | Mapping[str, Parameters | None] | None
"""What can be asked for, see :func:`choose_effects`."""

RANDOM_GROUPS = {"random": DRAWN, "outside": OUTSIDE}


def choose_effects(
    request: EffectRequest, session: Session, seed: int, *, number: int = 1, magnitude: str = "clear"
) -> dict[str, Effect]:
    """Return the requested effects with all their parameters, by name.

    Args:
        request: one of

            - None, ``none``, ``[]`` or ``{}``: no effect;
            - ``random``: ``number`` effects of the vocabulary (``DRAWN``); ``outside``: of those outside it;
            - a name or a list of names: their parameters are drawn from the seed;
            - ``{name: {parameter: value}}`` or ``[{"name": name, parameter: value}]``: the given parameters, the others
              at their neutral values; an effect without any parameter is drawn from the seed.
        session: the captures in which they are hidden; random effects are those that are visible in them.
        seed: of every random choice.
        number: how many effects, for ``random`` and ``outside``.
        magnitude: how strong the drawn effects are: ``clear``, ``weak`` (30 to 100 nats, see :func:`make_weak`) or
            ``faint`` (3 to 30 nats).

    Raises:
        BadInput: an unknown effect, parameter or magnitude, or a value out of range.
    """
    if magnitude != "clear" and magnitude not in GAINS:
        raise BadInput(f"magnitude must be clear, {' or '.join(GAINS)}, got {magnitude!r}")
    effects: dict[str, Effect] = {}
    for name, values in _requested(request, session, seed, number):
        if name not in EFFECTS:
            raise BadInput(f"no effect '{name}'; choose random, outside, none or of {', '.join(EFFECTS)}")
        if name in effects:
            raise BadInput(f"effect {name} is named twice")
        if values:
            effects[name] = EFFECTS[name].from_values(values, session)
        else:
            drawn = EFFECTS[name].draw(stream(seed, f"draw {name}"), session)
            drawn.check(session)
            effects[name] = make_weak(drawn, session, seed, GAINS[magnitude]) if magnitude in GAINS else drawn
    return effects


def _requested(request: object, session: Session, seed: int, number: int) -> list[tuple[str, Mapping[str, object]]]:
    """Return the names of the requested effects with the parameters that are given for them."""
    if request is None or request == "none":
        return []
    if isinstance(request, str) and request in RANDOM_GROUPS:
        group = [name for name, effect in RANDOM_GROUPS[request].items() if effect.is_visible_in(session)]
        if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= len(group):
            raise BadInput(f"number of {request} effects must be a whole number from 1 to {len(group)}, got {number!r}")
        return [(str(name), {}) for name in stream(seed, "effects").choice(group, number, replace=False)]
    if isinstance(request, str):
        return [(request, {})]
    if isinstance(request, Mapping):
        return [(str(name), _parameters(str(name), values)) for name, values in request.items()]
    if isinstance(request, Sequence):
        return [_entry(entry) for entry in request]
    raise BadInput(f"effects must be random, outside, none, names, or names with parameters; got {request!r}")


def _entry(entry: object) -> tuple[str, Mapping[str, object]]:
    """Return the name and the parameters of one entry of a list."""
    if isinstance(entry, str):
        return entry, {}
    if isinstance(entry, Mapping) and "name" in entry:
        return str(entry["name"]), {str(key): value for key, value in entry.items() if key != "name"}
    raise BadInput(f"an entry of effects is a name or {{name: NAME, parameter: value, ..}}, got {entry!r}")


def _parameters(name: str, values: object) -> Mapping[str, object]:
    """Return the parameters that are given for an effect, none for None."""
    if values is None:
        return {}
    if isinstance(values, Mapping):
        return values
    raise BadInput(f"effects.{name} must be parameters, as in effects.{name}.parameter=value; got {values!r}")
