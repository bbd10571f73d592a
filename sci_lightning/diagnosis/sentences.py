"""What was found, in plain words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from sci_lightning.diagnosis.residual_tests import ResidualTest

EFFECTS = {
    "pattern_order": "the patterns come {offset} slots late",
    "mask_orientation": "the mask's image is turned or mirrored ({operation})",
    "mask_level_gamma": "the modulator displays a level as its power of {gamma}",
    "mask_contrast": "closed mirrors let through {leak} of the light",
    "mask_lag": "{lag} of every pattern stays on during the next slot",
    "sync_offset": "patterns come {offset} slots late",
    "mask_shift": "the mask's image is displaced by ({dx}, {dy}) pixel",
    "mask_rotation": "the mask's image is turned by {angle} degree",
    "mask_scale": "the mask's image is {scale} times as large as it should be",
    "mask_blur": "the mask's image is blurred (sigma {sigma} pixel)",
    "flicker": "the light flickers by {amplitude} of its mean, {frequency} times per exposure",
    "rolling_shutter": "the last row is exposed {delay} slots after the first",
    "optical_blur": "the whole image is blurred (sigma {sigma} pixel)",
    "vignetting": "the corners lose {strength} of their light",
    "veiling_glare": "{fraction} of the light is spread evenly over the image",
    "gain": "the sensor's gain is {factor} times the nominal one",
    "prnu": "pixels differ in gain by {std} (standard deviation)",
    "shot_noise": "the full well holds {full_well} electrons",
    "saturation": "the sensor saturates at {level} of full scale",
    "response_gamma": "the sensor responds with the power {gamma} of the light",
    "black_level": "black is recorded as {offset} of full scale",
    "column_noise": "columns differ by offsets of {std} of full scale (standard deviation)",
    "row_noise": "rows differ by offsets of {std} of full scale (standard deviation)",
    "hot_pixels": "{fraction} of the pixels are hot",
    "read_noise": "the read noise is {std} DN",
    "bit_depth": "only {bits} bits of the converter count",
}
"""What every effect of the package means, with its parameters."""

MOST = 3
"""Effects that a headline tells of in words."""


def headline(report: Mapping[str, Any], left: Sequence[ResidualTest]) -> str:
    """The verdict in one sentence.

    Args:
        report: ``report.json``.
        left: residual tests that are significant with everything that was found in the model.
    """
    before, after = (chi2(report["gap"][when]["chi2"]) for when in ("before", "after"))
    rest = _rest(report, left)
    if not report["effects"]:
        if rest == CLEAN:
            return f"The captures agree with the ideal camera: held-out chi2 {after}, and {CLEAN}."
        if report["unnamed"]:
            verdict = f"The captures disagree with the ideal camera (held-out chi2 {before}) and no name explains it"
            fallen = report["gap"]["after"]["chi2"] < 0.999 * report["gap"]["before"]["chi2"]
            return f"{verdict}: {_places(report)}{f'; in free form it leaves {after}' if fallen else ''}."
        return f"The captures disagree with the ideal camera (held-out chi2 {after}) and no name explains it: {rest}."
    told = [say(effect) for effect in report["effects"]]
    found = " and ".join(filter(None, (", ".join(told[:-1]), told[-1])))
    if len(told) > MOST:
        found = f"{len(told)} effects act together: {', '.join(each['name'] for each in report['effects'])}"
    link = "and" if rest == CLEAN else "but"
    falls = "falls" if float(before) > float(after) else "goes"  # less noise than stated: up towards 1
    fall = f"with that in the model the held-out misfit {falls} from chi2 {before} to {after}"
    return f"{found[0].upper()}{found[1:]}; {fall}, {link} {rest}."


CLEAN = "nothing significant is left"


def _rest(report: Mapping[str, Any], left: Sequence[ResidualTest]) -> str:
    if report["unnamed"]:
        return f"something without a name is left ({_places(report)})"
    if left:
        names = ", ".join(each.name for each in left[:4]) + (", .." if len(left) > 4 else "")
        return f"the residuals are not noise yet ({names})"
    return CLEAN


def _places(report: Mapping[str, Any]) -> str:
    return ", and ".join(f"in the {each['stage']}, {each['where']}" for each in report["unnamed"])


def say(effect: Mapping[str, Any]) -> str:
    """One effect of the report with its parameters and their standard deviations."""
    values = {name: quantity(each["value"], each["std"]) for name, each in effect["parameters"].items()}
    if effect["name"] in EFFECTS:
        return EFFECTS[effect["name"]].format(**values)
    units = {name: each["unit"].removeprefix("1") for name, each in effect["parameters"].items()}
    told = ", ".join(f"{name} {value} {units[name]}".strip() for name, value in values.items())
    return f"{effect['name']} ({told})"


def quantity(value: float | int | str, std: float = 0.0) -> str:
    """A number with its standard deviation, both to the digits that mean something."""
    if not isinstance(value, float):
        return str(value)
    if not std > 0 or not math.isfinite(std):
        return f"{value:.6g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{digits}f} \u00b1 {std:.{digits}f}"


def chi2(value: float) -> str:
    """A reduced chi2, to the digits that mean something."""
    return f"{value:.0f}" if value >= 1000 else f"{value:.4g}" if value >= 10 else f"{value:.3f}"
