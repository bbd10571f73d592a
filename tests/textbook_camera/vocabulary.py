"""Deviations in the words and units of the captures contract, and what each of them is in the camera's own units.

Every entry says how its strength is drawn and how it is converted. Strengths are drawn log-uniformly between a
weakest value, which is meant to be clear in 34 captures of 64 x 64 pixels, and a strong one; signs and directions
are drawn uniformly. The truth states a parameter only where the contract leaves one reading; where it leaves several
(of a blur: sampled at the pixels or integrated over them) ``tolerance`` is how far they lie apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.textbook_camera.camera import PIXEL_UM, SLOTS, Colour, Datasheet

Rng = np.random.Generator
Values = dict[str, Any]


@dataclass(frozen=True)
class Deviation:
    """One thing that can be hidden: its stage, how to draw it in the contract's units, and how to build it in."""

    stage: str
    draw: Callable[[Rng, Datasheet], Values]
    build: Callable[[Values], Values]
    tolerance: Callable[[Values], Values] = lambda values: {}
    unsigned: tuple[str, ...] = ()  # parameters whose sign the contract does not fix
    left_out: tuple[str, ...] = ()  # parameters that the contract does not define well enough to compare
    other_stages: tuple[str, ...] = ()  # of a deviation without a word: where else its misfit may be reported
    tolerated: tuple[str, ...] = ()  # names that hold a part of the truth: neither right nor wrong
    gray: bool = False  # needs patterns of more than two levels
    stage_motion: bool = False  # needs targets that move within a slot


def amount(low: float, high: float) -> Callable[[Rng], float]:
    """Return a function that draws log-uniformly between two strengths."""
    return lambda rng: float(np.exp(rng.uniform(np.log(low), np.log(high))))


def one(
    name: str, low: float, high: float, signed: bool = False, about: float = 0.0
) -> Callable[[Rng, Datasheet], Values]:
    """Return a function that draws one parameter, ``about`` plus a strength, of either sign where ``signed``."""
    return lambda rng, _: {name: about + amount(low, high)(rng) * (rng.choice([-1.0, 1.0]) if signed else 1.0)}


def power(name: str, low: float, high: float) -> Callable[[Rng, Datasheet], Values]:
    """Return a function that draws an exponent between ``low`` and ``high``, both above 1, or its inverse."""
    return lambda rng, _: {name: (1.0 + amount(low - 1.0, high - 1.0)(rng)) ** float(rng.choice([-1.0, 1.0]))}


def vector(first: str, second: str, low: float, high: float) -> Callable[[Rng, Datasheet], Values]:
    """Return a function that draws a vector by its length and a uniform direction."""

    def draw(rng: Rng, _: Datasheet) -> Values:
        length, angle = amount(low, high)(rng), rng.uniform(0.0, 2.0 * np.pi)
        return {first: length * np.cos(angle), second: length * np.sin(angle)}

    return draw


def choice(name: str, *options: Any) -> Callable[[Rng, Datasheet], Values]:
    """Return a function that draws one of the options."""
    return lambda rng, _: {name: options[rng.integers(len(options))]}


def same(name: str, field: str, scale: float = 1.0, offset: float = 0.0) -> Callable[[Values], Values]:
    """Return a function that builds a parameter into a field: ``(value - offset) * scale``."""
    return lambda values: {field: (values[name] - offset) * scale}


def part(name: str, relative: float) -> Callable[[Values], Values]:
    """Return the tolerance of a parameter as a part of its value."""
    return lambda values: {name: relative * abs(values[name])}


def blur(*names: str) -> Callable[[Values], Values]:
    """Return the tolerance of widths: a pixel's or a mirror's own width may count in them or not.

    A width that describes the same kernel between the centres of mirrors and pixels is up to the root of
    ``sigma^2 + 1/6``, for the variance of two square pixels of side 1 is 1/12 each.
    """
    return lambda values: {name: float(np.sqrt(values[name] ** 2 + 1.0 / 6.0) - values[name]) for name in names}


def pixels(first: str, second: str, field: str) -> Callable[[Values], Values]:
    """Return a function that builds a vector in pixels into a field in micrometres."""
    return lambda values: {field: (values[first] * PIXEL_UM, values[second] * PIXEL_UM)}


def _field_blur(values: Values) -> Values:
    centre, corner = values["centre"] * PIXEL_UM, values["corner"] * PIXEL_UM
    return {"lens_sigma_um": (centre, centre), "corner_sigma_um": corner - centre}


def _dispersion(values: Values) -> Values:
    """Build three colours that a prism displaces along the rows, with shares 0.3, 0.4 and 0.3."""
    away = values["pixels"] * PIXEL_UM
    return {"colours": (Colour(0.3, 0.0, -away), Colour(0.4), Colour(0.3, 0.0, away))}


DEGREE = np.pi / 180.0

WORDS: dict[str, Deviation] = {
    "pattern_order": Deviation("modulator", choice("offset", 1, 2, 3), same("offset", "slots_late")),
    "mask_orientation": Deviation(
        "modulator",
        choice("operation", "flip_lr", "flip_ud", "rot180", "transpose"),
        lambda v: {"orientation": v["operation"]},
    ),
    "mask_level_gamma": Deviation("modulator", power("gamma", 1.04, 1.6), same("gamma", "level_exponent"), gray=True),
    "mask_contrast": Deviation("modulator", one("leak", 0.005, 0.1), same("leak", "off_light")),
    "mask_lag": Deviation("modulator", one("lag", 0.05, 0.25), same("lag", "retention")),
    "sync_offset": Deviation("modulator", one("offset", 0.05, 0.4, signed=True), same("offset", "late_slots")),
    "mask_shift": Deviation("relay", vector("dx", "dy", 0.05, 3.0), pixels("dx", "dy", "decentre_um")),
    # The contract does not say which way an angle is positive.
    "mask_rotation": Deviation(
        "relay", one("angle", 0.05, 2.0, signed=True), same("angle", "roll_rad", DEGREE), unsigned=("angle",)
    ),
    "mask_scale": Deviation(
        "relay", one("scale", 0.002, 0.04, signed=True, about=1.0), same("scale", "magnification_error", 1.0, 1.0)
    ),
    "mask_blur": Deviation("relay", one("sigma", 0.35, 1.5), same("sigma", "relay_sigma_um", PIXEL_UM), blur("sigma")),
    # Half the diagonal may be counted to the outer edges of the corner pixels or to their centres: 1.6 % of R at 64.
    "mask_distortion": Deviation("relay", one("k", 0.004, 0.05, signed=True), same("k", "radial"), part("k", 0.033)),
    # Magnification at an edge may be that of lengths along the edge (here) or across it, different in second order.
    "mask_keystone": Deviation(
        "relay",
        vector("tilt_x", "tilt_y", 0.004, 0.04),
        lambda v: {"tilt": (v["tilt_x"], v["tilt_y"])},
        lambda v: dict.fromkeys(v, 0.016 * np.hypot(*v.values()) + np.hypot(*v.values()) ** 2),
    ),
    "lateral_colour": Deviation(
        "relay",
        one("spread", 0.003, 0.02),
        lambda v: {"colours": (Colour(0.5, v["spread"]), Colour(0.5, -v["spread"]))},
        unsigned=("spread",),
    ),
    "duty_cycle": Deviation(
        "exposure", lambda rng, _: {"fraction": 1.0 - amount(0.02, 0.3)(rng)}, same("fraction", "duty")
    ),
    "phased_reset": Deviation("exposure", one("delay", 0.1, 1.0), same("delay", "reset_slots")),
    "bit_planes": Deviation(
        "exposure",
        choice("order", "msb_first", "lsb_first"),
        lambda v: {"planes": (3, 2, 1, 0) if v["order"] == "msb_first" else (0, 1, 2, 3)},
        gray=True,
        stage_motion=True,
    ),
    # The contract does not say whether a slot's light is its mean or that of its middle, nor where the phase begins.
    "flicker": Deviation(
        "exposure",
        lambda rng, _: {
            "amplitude": amount(0.02, 0.3)(rng),
            "frequency": rng.uniform(0.8, 3.2),
            "phase": rng.uniform(-np.pi, np.pi),
        },
        lambda v: {"flicker_depth": v["amplitude"], "flicker_cycles": v["frequency"], "flicker_phase_rad": v["phase"]},
        lambda v: {"amplitude": v["amplitude"] * (1.0 - np.sinc(v["frequency"] / SLOTS))},
        left_out=("phase",),
    ),
    "rolling_shutter": Deviation("exposure", one("delay", 0.15, 1.0), same("delay", "shutter_slots")),
    "optical_blur": Deviation(
        "optics", one("sigma", 0.35, 1.5), lambda v: {"lens_sigma_um": (v["sigma"] * PIXEL_UM,) * 2}, blur("sigma")
    ),
    "field_blur": Deviation(
        "optics",
        lambda rng, _: {"centre": rng.uniform(0.3, 0.6), "corner": rng.uniform(0.9, 1.8)},
        _field_blur,
        blur("centre", "corner"),
    ),
    "vignetting": Deviation(
        "optics", one("strength", 0.03, 0.35), same("strength", "vignetting"), part("strength", 0.033)
    ),
    # Glare of a lens comes from all that it sees, not only from what falls onto the sensor.
    "veiling_glare": Deviation("optics", one("fraction", 0.01, 0.15), same("fraction", "glare"), part("fraction", 0.1)),
    "illumination": Deviation("optics", one("std", 0.01, 0.08), same("std", "uneven"), part("std", 0.05)),
    "gain": Deviation(
        "sensor", one("factor", 0.02, 0.15, signed=True, about=1.0), same("factor", "quantum_efficiency")
    ),
    "prnu": Deviation("sensor", one("std", 0.005, 0.04), same("std", "pixel_gain"), part("std", 0.02)),
    "shot_noise": Deviation(
        "sensor",
        lambda rng, sheet: {"full_well": sheet.full_well_e * amount(0.3, 0.75)(rng)},
        same("full_well", "full_scale_e"),
    ),
    "saturation": Deviation("sensor", lambda rng, _: {"level": rng.uniform(0.7, 0.95)}, same("level", "well")),
    "response_gamma": Deviation("sensor", power("gamma", 1.04, 1.3), same("gamma", "response_exponent")),
    "black_level": Deviation("sensor", one("offset", 0.004, 0.05), same("offset", "pedestal")),
    "column_noise": Deviation("sensor", one("std", 0.002, 0.02), same("std", "column_offset"), part("std", 0.02)),
    "row_noise": Deviation("sensor", one("std", 0.002, 0.02), same("std", "row_offset"), part("std", 0.02)),
    "hot_pixels": Deviation(
        "sensor", one("fraction", 0.001, 0.01), same("fraction", "hot"), lambda v: {"fraction": 2e-4}
    ),
    "read_noise": Deviation(
        "sensor",
        lambda rng, sheet: {"std": sheet.read_noise_dn * amount(1.5, 4.0)(rng)},
        same("std", "read_noise_dn"),
    ),
    "bit_depth": Deviation("sensor", choice("bits", 5, 6, 7), same("bits", "converter_bits")),
    "scene_shift": Deviation("scene", vector("dx", "dy", 0.15, 2.0), pixels("dx", "dy", "target_shift_um")),
    "scene_rotation": Deviation(
        "scene", one("angle", 0.15, 1.5, signed=True), same("angle", "target_roll_rad", DEGREE), unsigned=("angle",)
    ),
    "scene_scale": Deviation(
        "scene",
        one("scale", 0.004, 0.03, signed=True, about=1.0),
        same("scale", "target_magnification_error", 1.0, 1.0),
    ),
    "scene_blur": Deviation("scene", one("sigma", 0.4, 1.5), same("sigma", "target_sigma_um", PIXEL_UM), blur("sigma")),
    "scene_gamma": Deviation("scene", power("gamma", 1.05, 1.4), same("gamma", "target_exponent")),
}

OUTSIDE: dict[str, Deviation] = {
    "knee": Deviation(
        "sensor", one("loss", 0.07, 0.4), lambda v: {"knee": (0.6, 1.0 - v["loss"])}, tolerated=("response_gamma",)
    ),
    "cubic_response": Deviation(
        "sensor", one("curvature", 0.03, 0.12, signed=True), same("curvature", "cubic"), tolerated=("response_gamma",)
    ),
    "astigmatism": Deviation(
        "optics",
        lambda rng, _: {"along_y": rng.uniform(0.3, 0.5), "along_x": rng.uniform(0.9, 1.6)},
        lambda v: {"lens_sigma_um": (v["along_y"] * PIXEL_UM, v["along_x"] * PIXEL_UM)},
        tolerated=("optical_blur", "field_blur"),
    ),
    "tilted_sensor": Deviation(
        "optics",
        one("edge", 0.4, 0.8, signed=True),
        lambda v: {"lens_sigma_um": (0.85 * PIXEL_UM,) * 2, "edge_sigma_um": v["edge"] * PIXEL_UM},
        tolerated=("optical_blur", "field_blur"),
    ),
    "ghost": Deviation("optics", one("part", 0.02, 0.08), same("part", "ghost"), tolerated=("veiling_glare",)),
    "stray_spot": Deviation(
        "optics",
        one("peak", 0.01, 0.06),
        same("peak", "stray_spot"),
        other_stages=("sensor",),
        tolerated=("black_level",),
    ),
    "swapped_patterns": Deviation(
        "modulator",
        lambda rng, _: dict(zip(("first", "second"), sorted(rng.permutation(SLOTS)[:2].tolist()), strict=True)),
        lambda v: {"swapped": (v["first"], v["second"])},
    ),
    "stuck_mirrors": Deviation("modulator", one("part", 0.003, 0.02), same("part", "stuck")),
    "prism": Deviation("relay", one("pixels", 0.3, 1.2), _dispersion, tolerated=("mask_blur",)),
    # Exposures that drift may as well be reported as an imperfection of the laboratory.
    "source_drift": Deviation(
        "exposure", one("relative", 0.03, 0.1, signed=True), same("relative", "drift"), other_stages=("laboratory",)
    ),
    "crosstalk": Deviation(
        "sensor",
        one("part", 0.01, 0.04),
        same("part", "crosstalk"),
        other_stages=("optics",),
        tolerated=("optical_blur",),
    ),
    "image_lag": Deviation("sensor", one("part", 0.01, 0.05), same("part", "image_lag"), other_stages=("exposure",)),
    "blooming": Deviation(
        "sensor", lambda rng, _: {"part": rng.uniform(0.5, 0.95)}, lambda v: {"blooming": v["part"], "well": 1.0}
    ),
    "pixel_offset": Deviation("sensor", one("std", 0.003, 0.02), same("std", "pixel_offset")),
}
"""Deviations for which the contract has no word: no name is right, only the stage of what is left unnamed."""
